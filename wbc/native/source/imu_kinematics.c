/* Poses of feet and base relative to the IMU, by the joints between: see wbc/estimation/estimator.py. */
#include "core.h"
#include "linear.h"

#include <string.h>

int wbc_foot_place(int64_t nv, const double *imu, const double *foot, const double *rates, double variance,
                   const double *floor, double *place, double *noise) {
    const double *R = imu + FRAME_ROTATION, *own = imu + FRAME_JACOBIAN, *other = foot + FRAME_JACOBIAN;
    double arm[3], J[6], sum[21] = {0.0};
    for (int i = 0; i < 3; i++) arm[i] = foot[i] - imu[i];
    transposed_times3(R, arm, place);
    transposed_product3(R, foot + FRAME_ROTATION, place + 3);
    for (int i = 0; i < 3; i++) place[PLACE_VELOCITY + i] = 0.0;
    for (int64_t j = 6; j < nv; j++) { /* motion of the foot by joint j, seen from the IMU */
        double column[6], carried[3];
        int moves = 0;
        for (int i = 0; i < 6; i++) column[i] = other[i * nv + j] - own[i * nv + j];
        const double w[3] = {own[3 * nv + j], own[4 * nv + j], own[5 * nv + j]};
        cross3(w, arm, carried);
        for (int i = 0; i < 3; i++) column[i] -= carried[i];
        for (int i = 0; i < 6; i++) moves |= column[i] != 0.0;
        if (!moves) continue;
        transposed_times3(R, column, J);
        transposed_times3(R, column + 3, J + 3);
        for (int i = 0; i < 3; i++) place[PLACE_VELOCITY + i] += J[i] * rates[j - 6];
        for (int i = 0, at = 0; i < 6; i++)
            for (int k = 0; k <= i; k++) sum[at++] += J[i] * J[k];
    }
    for (int i = 0, at = 0; i < 6; i++)
        for (int k = 0; k <= i; k++) noise[6 * i + k] = noise[6 * k + i] = variance * sum[at++];
    for (int i = 0; i < 6; i++) noise[7 * i] += floor[i / 3];
    return DONE;
}

/* The unit quaternion x y z w of a rotation, its largest entry positive. */
static void quaternion(const double *R, double *out) {
    const double w = R[0] + R[4] + R[8];
    int i = R[4] > R[0] ? 1 : 0;
    if (R[8] > R[4 * i]) i = 2;
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    if (w > 0.0 && w >= R[4 * i]) {
        const double s = 2.0 * sqrt(1.0 + w);
        out[3] = 0.25 * s;
        out[0] = (R[7] - R[5]) / s, out[1] = (R[2] - R[6]) / s, out[2] = (R[3] - R[1]) / s;
        return;
    }
    const double s = 2.0 * sqrt(1.0 + R[4 * i] - R[4 * j] - R[4 * k]);
    out[i] = 0.25 * s;
    out[j] = (R[3 * j + i] + R[3 * i + j]) / s;
    out[k] = (R[3 * k + i] + R[3 * i + k]) / s;
    out[3] = (R[3 * k + j] - R[3 * j + k]) / s;
}

int wbc_filter_base(const wbc_filter *filter, int64_t nv, const double *imu, const double *rate, const double *rates,
                    double *q, double *v) {
    const double *x = filter->x, *own = imu + FRAME_ROTATION, *J = imu + FRAME_JACOBIAN;
    double R[9], arm[3], moved[6], turn[3], carried[3], along[3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) R[3 * i + j] = dot3(x + 3 * i, own + 3 * j);
    times3(R, imu, arm);
    for (int i = 0; i < 3; i++) {
        q[i] = x[FILTER_P + i] - arm[i] + filter->origin[i];
        turn[i] = rate[i] - x[FILTER_GYRO + i];
    }
    quaternion(R, q + 3);
    for (int i = 0; i < 6; i++) moved[i] = dot(nv - 6, J + i * nv + 6, rates);
    times3(own, turn, v + 3);
    for (int i = 0; i < 3; i++) v[3 + i] -= moved[3 + i];
    cross3(v + 3, imu, carried);
    transposed_times3(R, x + FILTER_V, along);
    for (int i = 0; i < 3; i++) v[i] = along[i] - carried[i] - moved[i];
    memcpy(v + 6, rates, (nv - 6) * sizeof *v);
    return DONE;
}

double wbc_filter_foot_speed(const wbc_filter *filter, const double *rate, const double *place) {
    double turn[3], carried[3], own[3];
    for (int i = 0; i < 3; i++) turn[i] = rate[i] - filter->x[FILTER_GYRO + i];
    cross3(turn, place, carried);
    transposed_times3(filter->x, filter->x + FILTER_V, own);
    for (int i = 0; i < 3; i++) own[i] += carried[i] + place[PLACE_VELOCITY + i];
    return sqrt(dot3(own, own));
}
