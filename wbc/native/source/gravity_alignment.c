/* The start of an estimate: the tilt at which an IMU at rest measures gravity, and zero velocity. */
#include "estimator.h"
#include "rotation.h"

static const double TILT = 0.05; /* rad: standard deviation of that tilt */
static const double STEEP = 0.8; /* vertical part of an axis that has no heading */

static void rotation_of(const double *r, double *R) {
    double c[4];
    coefficients(r, c);
    polynomial(r, 1.0, c[0], c[1], R);
}

/* The shortest rotation from one unit vector to another. */
static void shortest_rotation(const double *a, const double *b, double *R) {
    double axis[3], by[3] = {0.0, 0.0, 0.0};
    cross3(a, b, axis);
    const double sine = sqrt(dot3(axis, axis)), cosine = dot3(a, b);
    if (sine < 1e-12 && cosine < 0.0) { /* half a turn about a perpendicular axis */
        double least[3] = {0.0, 0.0, 0.0};
        int i = fabs(a[1]) < fabs(a[0]) ? 1 : 0;
        if (fabs(a[2]) < fabs(a[i])) i = 2;
        least[i] = 1.0;
        cross3(a, least, axis);
        const double size = sqrt(dot3(axis, axis));
        for (int j = 0; j < 3; j++) by[j] = PI * axis[j] / size;
    } else if (sine >= 1e-12) {
        for (int j = 0; j < 3; j++) by[j] = atan2(sine, cosine) / sine * axis[j];
    }
    rotation_of(by, R);
}

int wbc_align_to_gravity(const wbc_estimator *e, const double *rate, const double *force) {
    enum { SHOWN = 15 };
    const int64_t size = FRAME_SIZE(e->tree->nv);
    const double *soles = e->frames + e->imus * size, *imu = soles + e->feet * size;
    const double *own = imu + FRAME_ROTATION, *start = e->start, *gravity = e->filter->gravity;
    const double weight = sqrt(dot3(gravity, gravity)), felt = sqrt(dot3(force, force));
    double up[3], along[3], R_shortest[9], axis[3], by[3] = {0.0, 0.0, 0.0}, Z[9], R[9];
    double state[FILTER_FEET] = {0.0}, P[SHOWN * SHOWN] = {0.0}, base[3], at[3];
    e->detail[0] = felt;
    if (!(felt >= 0.5 * weight)) return NO_GRAVITY;
    const int told = start[3] != 0.0 || start[4] != 0.0 || start[5] != 0.0 || start[6] != 0.0;
    for (int i = 0; i < 3; i++) up[i] = -gravity[i] / weight, along[i] = force[i] / felt;
    shortest_rotation(along, up, R_shortest); /* with an arbitrary heading */
    times3(R_shortest, own, axis);            /* the base's x axis, or its y axis where that is steep */
    const int y = fabs(axis[2]) > STEEP;
    double wanted[2] = {!y, y};
    if (y) times3(R_shortest, own + 3, axis);
    if (told) {
        wanted[y] = 1.0 - 2.0 * (start[4 - y] * start[4 - y] + start[5] * start[5]);
        wanted[!y] = 2.0 * (start[3] * start[4] + (y ? -1.0 : 1.0) * start[6] * start[5]);
    }
    by[2] = atan2(wanted[1], wanted[0]) - atan2(axis[1], axis[0]);
    rotation_of(by, Z);
    product3(Z, R_shortest, state);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) R[3 * i + j] = dot3(state + 3 * i, own + 3 * j);
    if (told) memcpy(base, start, sizeof base);
    else { /* the centre of the soles at the world's origin */ double middle[3] = {0.0, 0.0, 0.0};
        for (int64_t k = 0; k < e->feet; k++)
            for (int i = 0; i < 3; i++) middle[i] -= soles[k * size + i] / (double)e->feet;
        times3(R, middle, base);
    }
    times3(R, imu, at);
    for (int i = 0; i < 3; i++) {
        state[FILTER_P + i] = base[i] + at[i], state[FILTER_GYRO + i] = rate[i];
        for (int j = 0; j < 3; j++) P[SHOWN * i + j] = TILT * TILT * ((i == j) - up[i] * up[j]);
        P[(SHOWN + 1) * (9 + i)] = e->bias_variances[0], P[(SHOWN + 1) * (12 + i)] = e->bias_variances[1];
    }
    return wbc_filter_reset(e->filter, state, P);
}
