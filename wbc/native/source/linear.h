/* Small vectors, and symmetric (3, 3) matrices as xx xy xz yy yz zz. */
#ifndef WBC_LINEAR_H
#define WBC_LINEAR_H

#include <stdint.h>

static inline double dot3(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Of n entries; four sums, since one would wait for itself. */
static inline double dot(int64_t n, const double *a, const double *b) {
    double sum[4] = {0.0};
    int64_t i = 0;
    for (; i + 4 <= n; i += 4)
        for (int j = 0; j < 4; j++) sum[j] += a[i + j] * b[i + j];
    for (; i < n; i++) sum[0] += a[i] * b[i];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

static inline void cross3(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* out = A x */
static inline void times3(const double *A, const double *x, double *out) {
    for (int i = 0; i < 3; i++) out[i] = dot3(A + 3 * i, x);
}

/* out = A' x */
static inline void transposed_times3(const double *A, const double *x, double *out) {
    for (int i = 0; i < 3; i++) out[i] = A[i] * x[0] + A[3 + i] * x[1] + A[6 + i] * x[2];
}

/* out = A B */
static inline void product3(const double *A, const double *B, double *out) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[3 * i + j] = A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j];
}

/* out = A' B */
static inline void transposed_product3(const double *A, const double *B, double *out) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[3 * i + j] = A[i] * B[j] + A[3 + i] * B[3 + j] + A[6 + i] * B[6 + j];
}

/* out = S x, S symmetric */
static inline void symmetric_times(const double *S, const double *x, double *out) {
    out[0] = S[0] * x[0] + S[1] * x[1] + S[2] * x[2];
    out[1] = S[1] * x[0] + S[3] * x[1] + S[4] * x[2];
    out[2] = S[2] * x[0] + S[4] * x[1] + S[5] * x[2];
}

/* out = R S R', S symmetric */
static inline void congruent(const double *R, const double *S, double *out) {
    double T[9];
    for (int i = 0; i < 3; i++) symmetric_times(S, R + 3 * i, T + 3 * i);
    out[0] = dot3(R, T), out[1] = dot3(R, T + 3), out[2] = dot3(R, T + 6);
    out[3] = dot3(R + 3, T + 3), out[4] = dot3(R + 3, T + 6), out[5] = dot3(R + 6, T + 6);
}

/* S += factor ((a.b) 2 - a b' - b a'): with a = b half of it is the parallel-axis theorem. */
static inline void add_turning(double *S, double factor, const double *a, const double *b) {
    const double twice = 2.0 * dot3(a, b);
    S[0] += factor * (twice - 2.0 * a[0] * b[0]);
    S[1] -= factor * (a[0] * b[1] + a[1] * b[0]);
    S[2] -= factor * (a[0] * b[2] + a[2] * b[0]);
    S[3] += factor * (twice - 2.0 * a[1] * b[1]);
    S[4] -= factor * (a[1] * b[2] + a[2] * b[1]);
    S[5] += factor * (twice - 2.0 * a[2] * b[2]);
}

/* S += [w] M - M [w], the rate of a symmetric M that is carried round at w */
static inline void add_commutator(double *S, const double *M, const double *w) {
    const double a = M[0], b = M[1], c = M[2], d = M[3], e = M[4], f = M[5];
    S[0] += 2.0 * (c * w[1] - b * w[2]);
    S[1] += -c * w[0] + e * w[1] + (a - d) * w[2];
    S[2] += b * w[0] + (f - a) * w[1] - e * w[2];
    S[3] += 2.0 * (b * w[2] - e * w[0]);
    S[4] += (d - f) * w[0] - b * w[1] + c * w[2];
    S[5] += 2.0 * (e * w[0] - c * w[1]);
}

#endif
