/* Contact-aided right-invariant extended Kalman filter (Hartley, Ghaffari, Eustice, Grizzle, IJRR
 * 2020), with the feet's rotations beside their positions. The error of a group element X is
 * log(X^ X^-1), in world axes; of a bias it is the difference. See wbc/estimation/contact_filter.py. */
#include "core.h"
#include "linear.h"

#include <string.h>

enum { ERROR_R = 0, ERROR_V = 3, ERROR_P = 6, ERROR_GYRO = 9, ERROR_ACCEL = 12, ERROR_FOOT = 15, ROWS = 6 };
#define SIZE(filter) (ERROR_FOOT + 6 * (filter)->feet)
/* Of a foot's error, the position's rows come first, then the rotation's. */
#define FOOT(k) (FILTER_FEET + FILTER_FOOT_SIZE * (k))
#define FOOT_ERROR(k) (ERROR_FOOT + 6 * (k))

/* exp(r) = 1 + c[0] [r] + c[1] [r]^2, and its integrals over time 1 + c[1] [r] + c[2] [r]^2 and
 * 1/2 + c[2] [r] + c[3] [r]^2 (Hartley et al., the appendix's Gamma 0, 1, 2). */
static void coefficients(const double *r, double *c) {
    const double tt = dot3(r, r), t = sqrt(tt);
    if (t < 0.1) { /* series: the closed form loses half the digits of c[3] */
        c[0] = 1.0 - tt / 6.0 * (1.0 - tt / 20.0 * (1.0 - tt / 42.0 * (1.0 - tt / 72.0)));
        c[1] = 0.5 * (1.0 - tt / 12.0 * (1.0 - tt / 30.0 * (1.0 - tt / 56.0 * (1.0 - tt / 90.0))));
        c[2] = (1.0 - tt / 20.0 * (1.0 - tt / 42.0 * (1.0 - tt / 72.0 * (1.0 - tt / 110.0)))) / 6.0;
        c[3] = (1.0 - tt / 30.0 * (1.0 - tt / 56.0 * (1.0 - tt / 90.0 * (1.0 - tt / 132.0)))) / 24.0;
        return;
    }
    c[0] = sin(t) / t;
    c[1] = (1.0 - cos(t)) / tt;
    c[2] = (1.0 - c[0]) / tt;
    c[3] = (0.5 - c[1]) / tt;
}

/* out = a + b [r] + c [r]^2 */
static void polynomial(const double *r, double a, double b, double c, double *out) {
    const double tt = dot3(r, r);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) out[3 * i + j] = c * r[i] * r[j] + (i == j ? a - c * tt : 0.0);
    out[1] -= b * r[2], out[2] += b * r[1], out[3] += b * r[2];
    out[5] -= b * r[0], out[6] -= b * r[1], out[7] += b * r[0];
}

/* R <- R (3 - R'R) / 2, a Newton step to the nearest rotation: rounding does not add up. */
static void orthonormal(double *R) {
    double G[9], out[9];
    transposed_product3(R, R, G);
    for (int i = 0; i < 9; i++) G[i] = (i % 4 ? 0.0 : 1.5) - 0.5 * G[i];
    product3(R, G, out);
    memcpy(R, out, sizeof out);
}

/* Rotation vector of a rotation by less than a right angle or so: innovations are small. */
static void logarithm(const double *R, double *r) {
    const double s[3] = {0.5 * (R[7] - R[5]), 0.5 * (R[2] - R[6]), 0.5 * (R[3] - R[1])};
    const double sine = sqrt(dot3(s, s)), cosine = 0.5 * (R[0] + R[4] + R[8] - 1.0);
    const double scale = sine < 1e-8 ? 1.0 : atan2(sine, cosine) / sine;
    for (int i = 0; i < 3; i++) r[i] = scale * s[i];
}

/* Rows (3, n) += scale [u] R (rows): what a bias in the IMU's axes does far from the origin. */
static void add_crossed(int64_t n, double scale, const double *u, const double *turned, double *to) {
    for (int64_t j = 0; j < n; j++) {
        const double a = turned[j], b = turned[n + j], c = turned[2 * n + j];
        to[j] += scale * (u[1] * c - u[2] * b);
        to[n + j] += scale * (u[2] * a - u[0] * c);
        to[2 * n + j] += scale * (u[0] * b - u[1] * a);
    }
}

static void add_scaled(int64_t n, double scale, const double *rows, double *to) {
    for (int64_t j = 0; j < 3 * n; j++) to[j] += scale * rows[j];
}

/* out = R rows, (3, n) */
static void turn(int64_t n, const double *R, const double *rows, double *out) {
    for (int i = 0; i < 3; i++)
        for (int64_t j = 0; j < n; j++)
            out[i * n + j] =
                R[3 * i] * rows[j] + R[3 * i + 1] * rows[n + j] + R[3 * i + 2] * rows[2 * n + j];
}

static void transpose(int64_t n, double *P) {
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j < i; j++) {
            const double kept = P[i * n + j];
            P[i * n + j] = P[j * n + i];
            P[j * n + i] = kept;
        }
}

/* P <- Phi P, Phi = 1 + A dt + A^2 dt^2 / 2 with A by rotation, velocity and position in the middle of dt:
 * what is left out is of the order of dt^3. */
static void transition(const wbc_filter *filter, const double *middle, double dt, double *P,
                       double *scratch) {
    const int64_t n = SIZE(filter);
    const double *x = filter->x, *R = middle, *v = middle + FILTER_V, *p = middle + FILTER_P;
    const double *g = filter->gravity;
    const double half = 0.5 * dt * dt;
    double *by_gyro = scratch, *by_accel = scratch + 3 * n;
    turn(n, R, P + ERROR_GYRO * n, by_gyro);
    turn(n, R, P + ERROR_ACCEL * n, by_accel);
    double *rR = P + ERROR_R * n, *rv = P + ERROR_V * n, *rp = P + ERROR_P * n;
    add_scaled(n, dt, rv, rp);
    add_crossed(n, half, g, rR, rp);
    add_crossed(n, -dt, p, by_gyro, rp);
    add_crossed(n, -half, v, by_gyro, rp);
    add_scaled(n, -half, by_accel, rp);
    add_crossed(n, dt, g, rR, rv);
    add_crossed(n, -half, g, by_gyro, rv);
    add_crossed(n, -dt, v, by_gyro, rv);
    add_scaled(n, -dt, by_accel, rv);
    add_scaled(n, -dt, by_gyro, rR);
    for (int64_t k = 0; k < filter->feet; k++)
        if (filter->held[k]) add_crossed(n, -dt, x + FOOT(k), by_gyro, P + FOOT_ERROR(k) * n);
}

/* P += what the IMU's noise, the biases' walks and the feet's creep add over dt. */
static void add_noise(const wbc_filter *filter, double dt, double scale, double *scratch) {
    const int64_t n = SIZE(filter);
    const double *x = filter->x;
    double *P = filter->P, *G = scratch; /* (n, 3): how the gyroscope's noise comes in */
    const double gyro = scale * filter->gyroscope * dt, accel = scale * filter->accelerometer * dt;
    memset(G, 0, 3 * n * sizeof *G);
    for (int i = 0; i < 3; i++) G[3 * (ERROR_R + i) + i] = 1.0;
    polynomial(x + FILTER_V, 0.0, 1.0, 0.0, G + 3 * ERROR_V);
    polynomial(x + FILTER_P, 0.0, 1.0, 0.0, G + 3 * ERROR_P);
    for (int64_t k = 0; k < filter->feet; k++)
        if (filter->held[k]) polynomial(x + FOOT(k), 0.0, 1.0, 0.0, G + 3 * FOOT_ERROR(k));
    for (int64_t i = 0; i < n; i++) {
        const double *a = G + 3 * i;
        if (a[0] == 0.0 && a[1] == 0.0 && a[2] == 0.0) continue;
        for (int64_t j = 0; j < n; j++) P[i * n + j] += gyro * dot3(a, G + 3 * j);
    }
    for (int i = 0; i < 3; i++) {
        P[(ERROR_V + i) * (n + 1)] += accel;
        P[(ERROR_V + i) * n + ERROR_P + i] += 0.5 * accel * dt;
        P[(ERROR_P + i) * n + ERROR_V + i] += 0.5 * accel * dt;
        P[(ERROR_P + i) * (n + 1)] += accel * dt * dt / 3.0;
        P[(ERROR_GYRO + i) * (n + 1)] += filter->gyroscope_walk * dt;
        P[(ERROR_ACCEL + i) * (n + 1)] += filter->accelerometer_walk * dt;
    }
    for (int64_t k = 0; k < filter->feet; k++)
        for (int i = 0; filter->held[k] && i < 3; i++) {
            P[(FOOT_ERROR(k) + i) * (n + 1)] += filter->creep * dt;
            P[(FOOT_ERROR(k) + 3 + i) * (n + 1)] += filter->roll * dt;
        }
}

WIDE int wbc_filter_predict(const wbc_filter *filter, const double *rate, const double *force, double dt,
                            double scale) {
    const int64_t n = SIZE(filter);
    double *x = filter->x, *R = x, *v = x + FILTER_V, *p = x + FILTER_P, *scratch = filter->scratch;
    double r[3], a[3], c[4], turned[9], first[9], second[9], next[9], by_v[3], by_p[3], along[3];
    double middle[FILTER_GYRO], by_half[3];
    for (int i = 0; i < 3; i++) {
        r[i] = (rate[i] - x[FILTER_GYRO + i]) * dt, by_half[i] = 0.5 * r[i];
        a[i] = force[i] - x[FILTER_ACCEL + i];
    }
    coefficients(by_half, c);
    polynomial(by_half, 1.0, c[0], c[1], turned);
    product3(R, turned, middle);
    times3(middle, a, along);
    for (int i = 0; i < 3; i++) {
        middle[FILTER_V + i] = v[i] + 0.5 * dt * (along[i] + filter->gravity[i]);
        middle[FILTER_P + i] = p[i] + 0.5 * dt * v[i];
    }
    transition(filter, middle, dt, filter->P, scratch);
    transpose(n, filter->P);
    transition(filter, middle, dt, filter->P, scratch);
    add_noise(filter, dt, scale, scratch);

    coefficients(r, c);
    polynomial(r, 1.0, c[0], c[1], turned);
    polynomial(r, 1.0, c[1], c[2], first);
    polynomial(r, 0.5, c[2], c[3], second);
    times3(first, a, along);
    times3(R, along, by_v);
    times3(second, a, along);
    times3(R, along, by_p);
    for (int i = 0; i < 3; i++) {
        const double g = filter->gravity[i];
        p[i] += dt * v[i] + dt * dt * (by_p[i] + 0.5 * g);
        v[i] += dt * (by_v[i] + g);
    }
    product3(R, turned, next);
    memcpy(R, next, sizeof next);
    orthonormal(R);
    return DONE;
}

/* Write the noise of a foot's place (6, 6), turned from the IMU's axes to the world's. */
static void turned_noise(const double *R, const double *noise, double *out) {
    double half[36];
    for (int block = 0; block < 2; block++)
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 6; j++) {
                double sum = 0.0;
                for (int k = 0; k < 3; k++) sum += R[3 * i + k] * noise[6 * (3 * block + k) + j];
                half[6 * (3 * block + i) + j] = sum;
            }
    for (int i = 0; i < 6; i++)
        for (int block = 0; block < 2; block++)
            for (int j = 0; j < 3; j++) out[6 * i + 3 * block + j] = dot3(half + 6 * i + 3 * block, R + 3 * j);
}

int wbc_filter_hold(const wbc_filter *filter, int64_t foot, const double *place, const double *noise) {
    const int64_t n = SIZE(filter), at = FOOT_ERROR(foot);
    double *x = filter->x, *P = filter->P, *own = x + FOOT(foot), there[3], N[36];
    times3(x, place, there);
    for (int i = 0; i < 3; i++) own[i] = x[FILTER_P + i] + there[i];
    product3(x, place + 3, own + 3);
    for (int64_t i = 0; i < 6; i++)
        memcpy(P + (at + i) * n, P + (i < 3 ? ERROR_P + i : ERROR_R + i - 3) * n, n * sizeof *P);
    for (int64_t j = 0; j < n; j++)
        for (int64_t i = 0; i < 6; i++)
            P[j * n + at + i] = P[j * n + (i < 3 ? ERROR_P + i : ERROR_R + i - 3)];
    turned_noise(x, noise, N);
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) P[(at + i) * n + at + j] += N[6 * i + j];
    filter->held[foot] = 1;
    return DONE;
}

int wbc_filter_release(const wbc_filter *filter, int64_t foot) {
    const int64_t n = SIZE(filter), at = FOOT_ERROR(foot);
    for (int64_t i = 0; i < 6; i++)
        for (int64_t j = 0; j < n; j++) filter->P[(at + i) * n + j] = filter->P[j * n + at + i] = 0.0;
    filter->held[foot] = 0;
    return DONE;
}

/* X <- exp(-error) X, of the rotation, all vectors beside it and the feet's rotations. */
static void apply(const wbc_filter *filter, const double *error) {
    double *x = filter->x, r[3], c[4], E[9], J[9], next[9], step[3];
    for (int i = 0; i < 3; i++) r[i] = -error[ERROR_R + i];
    coefficients(r, c);
    polynomial(r, 1.0, c[0], c[1], E);
    polynomial(r, 1.0, c[1], c[2], J);
    product3(E, x, next);
    memcpy(x, next, sizeof next);
    for (int64_t k = -2; k < filter->feet; k++) {
        const int64_t at = k < 0 ? (k == -2 ? FILTER_V : FILTER_P) : FOOT(k);
        const int64_t row = k < 0 ? (k == -2 ? ERROR_V : ERROR_P) : FOOT_ERROR(k);
        if (k >= 0 && !filter->held[k]) continue;
        times3(E, x + at, next);
        times3(J, error + row, step);
        for (int i = 0; i < 3; i++) x[at + i] = next[i] - step[i];
        if (k < 0) continue;
        for (int i = 0; i < 3; i++) r[i] = -error[row + 3 + i];
        double turned[9], own[9];
        coefficients(r, c);
        polynomial(r, 1.0, c[0], c[1], turned);
        product3(turned, x + at + 3, own);
        memcpy(x + at + 3, own, sizeof own);
        orthonormal(x + at + 3);
    }
    for (int i = 0; i < 3; i++) {
        x[FILTER_GYRO + i] -= error[ERROR_GYRO + i];
        x[FILTER_ACCEL + i] -= error[ERROR_ACCEL + i];
    }
}

WIDE int wbc_filter_correct(const wbc_filter *filter, int64_t foot, const double *place, const double *noise,
                            int64_t rows, double gate, double *innovation) {
    const int64_t n = SIZE(filter), at = FOOT_ERROR(foot);
    double *x = filter->x, *P = filter->P, *own = x + FOOT(foot);
    double there[3], turned[9], apart[9], r[ROWS], y[ROWS], S[ROWS * ROWS], N[36];
    double *W = filter->scratch, *error = W + ROWS * n; /* H P, then L^-1 H P */
    times3(x, place, there);
    for (int i = 0; i < 3; i++) r[i] = x[FILTER_P + i] + there[i] - own[i];
    product3(x, place + 3, turned);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) apart[3 * i + j] = dot3(turned + 3 * i, own + 3 + 3 * j);
    logarithm(apart, r + 3);
    turned_noise(x, noise, N);
    for (int64_t i = 0; i < rows; i++) {
        const int64_t source = i < 3 ? ERROR_P + i : ERROR_R + i - 3;
        for (int64_t j = 0; j < n; j++) W[i * n + j] = P[source * n + j] - P[(at + i) * n + j];
    }
    for (int64_t i = 0; i < rows; i++)
        for (int64_t j = 0; j <= i; j++) {
            const int64_t source = j < 3 ? ERROR_P + j : ERROR_R + j - 3;
            double sum = W[i * n + source] - W[i * n + at + j] + N[6 * i + j];
            for (int64_t k = 0; k < j; k++) sum -= S[ROWS * i + k] * S[ROWS * j + k];
            if (i == j && !(sum > 0.0)) return NOT_FINITE;
            S[ROWS * i + j] = i == j ? sqrt(sum) : sum / S[ROWS * j + j];
        }
    innovation[0] = 0.0;
    for (int64_t i = 0; i < rows; i++) {
        y[i] = r[i];
        for (int64_t k = 0; k < i; k++) y[i] -= S[ROWS * i + k] * y[k];
        y[i] /= S[ROWS * i + i];
        innovation[0] += y[i] * y[i];
    }
    memcpy(innovation + 1, r, ROWS * sizeof *r);
    if (!(innovation[0] <= gate)) return OUTLIER;
    memset(error, 0, n * sizeof *error);
    for (int64_t i = 0; i < rows; i++) {
        double *row = W + i * n;
        for (int64_t k = 0; k < i; k++)
            for (int64_t j = 0; j < n; j++) row[j] -= S[ROWS * i + k] * W[k * n + j];
        const double by = 1.0 / S[ROWS * i + i];
        for (int64_t j = 0; j < n; j++) row[j] *= by, error[j] += row[j] * y[i];
    }
    for (int64_t i = 0; i < n; i++)
        for (int64_t k = 0; k < rows; k++) {
            const double w = W[k * n + i];
            if (w == 0.0) continue;
            for (int64_t j = 0; j < n; j++) P[i * n + j] -= w * W[k * n + j];
        }
    apply(filter, error);
    orthonormal(x);
    return DONE;
}

int wbc_filter_covariance(const wbc_filter *filter, double *out) {
    enum { SHOWN = 15 };
    const int64_t n = SIZE(filter);
    const double *x = filter->x;
    for (int64_t i = 0; i < SHOWN; i++) memcpy(out + SHOWN * i, filter->P + i * n, SHOWN * sizeof *out);
    for (int pass = 0; pass < 2; pass++) {
        add_crossed(SHOWN, -1.0, x + FILTER_V, out + SHOWN * ERROR_R, out + SHOWN * ERROR_V);
        add_crossed(SHOWN, -1.0, x + FILTER_P, out + SHOWN * ERROR_R, out + SHOWN * ERROR_P);
        transpose(SHOWN, out);
    }
    return DONE;
}

int wbc_foot_place(int64_t nv, const double *imu, const double *foot, const double *rates, double variance,
                   const double *floor, double *place, double *noise) {
    const double *R = imu + FRAME_ROTATION, *own = imu + FRAME_JACOBIAN, *other = foot + FRAME_JACOBIAN;
    double arm[3], J[6], sum[21] = {0.0};
    for (int i = 0; i < 3; i++) arm[i] = foot[i] - imu[i];
    transposed_times3(R, arm, place);
    transposed_product3(R, foot + FRAME_ROTATION, place + 3);
    for (int i = 0; i < 3; i++) place[PLACE_VELOCITY + i] = 0.0;
    for (int64_t j = 6; j < nv; j++) { /* how joint j moves the foot, seen from the IMU */
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

int wbc_filter_base(const wbc_filter *filter, int64_t nv, const double *imu, const double *rate,
                    const double *rates, double *q, double *v) {
    const double *x = filter->x, *own = imu + FRAME_ROTATION, *J = imu + FRAME_JACOBIAN;
    double R[9], arm[3], moved[6], turn[3], carried[3], along[3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) R[3 * i + j] = dot3(x + 3 * i, own + 3 * j);
    times3(R, imu, arm);
    for (int i = 0; i < 3; i++) {
        q[i] = x[FILTER_P + i] - arm[i];
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
