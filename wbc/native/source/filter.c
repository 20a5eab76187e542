/* Contact-aided right-invariant extended Kalman filter (Hartley, Ghaffari, Eustice, Grizzle, IJRR
 * 2020), with the feet's rotations beside their positions. The error of a group element X is
 * log(X^ X^-1), in world axes; of a bias it is the difference. See wbc/estimation/contact_filter.py. */
#include "core.h"
#include "rotation.h"

#include <string.h>

enum {
    ERROR_R = 0,
    ERROR_V = 3,
    ERROR_P = 6,
    ERROR_GYRO = 9,
    ERROR_ACCEL = 12,
    ERROR_FOOT = 15,
    ROWS = 6,
    SHOWN = ERROR_FOOT
};
static const double FAR_AWAY = 10.0; /* m from the IMU, at which the origin moves along */
#define SIZE(filter) (ERROR_FOOT + 6 * (filter)->feet)
/* Of a foot's error, the position's rows come first, then the rotation's. */
#define FOOT(k) (FILTER_FEET + FILTER_FOOT_SIZE * (k))
#define FOOT_ERROR(k) (ERROR_FOOT + 6 * (k))

/* Rows (3, n) += scale [u] R rows: the effect of a bias in the IMU's axes far from the origin. */
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
            out[i * n + j] = R[3 * i] * rows[j] + R[3 * i + 1] * rows[n + j] + R[3 * i + 2] * rows[2 * n + j];
}

static void transpose(int64_t n, double *P) {
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j < i; j++) {
            const double kept = P[i * n + j];
            P[i * n + j] = P[j * n + i];
            P[j * n + i] = kept;
        }
}

/* P <- Phi P, Phi = 1 + A dt + A^2 dt^2 / 2 with A at the middle of dt: the error is of the order of dt^3. */
static void transition(const wbc_filter *filter, const double *middle, double dt, double *P, double *scratch) {
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

/* P += noise of the IMU, random walks of the biases and creep of the feet over dt. */
static void add_noise(const wbc_filter *filter, double dt, double scale, double *scratch) {
    const int64_t n = SIZE(filter);
    const double *x = filter->x;
    double *P = filter->P, *G = scratch; /* (n, 3): columns of the gyroscope's noise */
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

/* Move the origin to the IMU: rounding grows with the square of the distance. With p' = p - s the invariant error
 * becomes p^ - s - exp(r) (p - s) = e_p - [s] r. */
static void move_origin(const wbc_filter *filter) {
    const int64_t n = SIZE(filter);
    double *x = filter->x, *P = filter->P, s[3];
    memcpy(s, x + FILTER_P, sizeof s);
    for (int i = 0; i < 3; i++) filter->origin[i] += s[i], x[FILTER_P + i] = 0.0;
    for (int64_t k = 0; k < filter->feet; k++)
        for (int i = 0; i < 3; i++) x[FOOT(k) + i] -= s[i];
    for (int pass = 0; pass < 2; pass++) {
        add_crossed(n, -1.0, s, P + ERROR_R * n, P + ERROR_P * n);
        for (int64_t k = 0; k < filter->feet; k++)
            if (filter->held[k]) add_crossed(n, -1.0, s, P + ERROR_R * n, P + FOOT_ERROR(k) * n);
        transpose(n, P);
    }
}

int wbc_filter_reset(const wbc_filter *filter, const double *state, const double *covariance) {
    const int64_t n = SIZE(filter);
    double *x = filter->x, *P = filter->P;
    memset(x, 0, FOOT(filter->feet) * sizeof *x);
    memset(P, 0, n * n * sizeof *P);
    if (filter->feet) memset(filter->held, 0, filter->feet * sizeof *filter->held);
    memcpy(x, state, FILTER_FEET * sizeof *x);
    for (int i = 0; i < 3; i++) filter->origin[i] = x[FILTER_P + i], x[FILTER_P + i] = 0.0;
    if (!covariance) return DONE;
    for (int64_t i = 0; i < SHOWN; i++) memcpy(P + i * n, covariance + SHOWN * i, SHOWN * sizeof *P);
    for (int pass = 0; pass < 2; pass++) { /* the invariant error of the velocity is v^ - exp(r) v */
        add_crossed(n, 1.0, x + FILTER_V, P + ERROR_R * n, P + ERROR_V * n);
        transpose(n, P);
    }
    return DONE;
}

int wbc_filter_follow(const wbc_filter *filter, const double *arm, const double *rotation, const double *biases,
                      const double *bias_variances, double velocity_variance) {
    double state[FILTER_FEET] = {0.0}, P[SHOWN * SHOWN];
    wbc_filter_covariance(filter, P);
    for (int i = 0; i < SHOWN; i++)
        for (int j = 0; j < SHOWN; j++)
            if (i >= ERROR_GYRO || j >= ERROR_GYRO)
                P[SHOWN * i + j] = i == j ? bias_variances[i >= ERROR_ACCEL] : 0.0;
    for (int pass = 0; pass < 2; pass++) { /* the new place rotates with the old one */
        add_crossed(SHOWN, -1.0, arm, P + SHOWN * ERROR_R, P + SHOWN * ERROR_P);
        transpose(SHOWN, P);
    }
    memcpy(state, rotation, 9 * sizeof *state);
    memcpy(state + FILTER_GYRO, biases, 6 * sizeof *state);
    for (int i = 0; i < 3; i++) {
        state[FILTER_V + i] = filter->x[FILTER_V + i];
        state[FILTER_P + i] = filter->x[FILTER_P + i] + filter->origin[i] + arm[i];
    }
    wbc_filter_reset(filter, state, P);
    return wbc_filter_widen(filter, velocity_variance);
}

int wbc_filter_widen(const wbc_filter *filter, double variance) {
    const int64_t n = SIZE(filter);
    for (int i = 0; i < 3; i++) filter->P[(ERROR_V + i) * (n + 1)] += variance;
    return DONE;
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
    if (fabs(p[0]) + fabs(p[1]) + fabs(p[2]) > FAR_AWAY) move_origin(filter);
    return DONE;
}

/* Write the noise of a foot's pose (6, 6), rotated from the IMU's axes to the world's. */
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
        for (int64_t i = 0; i < 6; i++) P[j * n + at + i] = P[j * n + (i < 3 ? ERROR_P + i : ERROR_R + i - 3)];
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

/* X <- exp(-error) X: the rotation, all vectors and the feet's rotations. */
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
