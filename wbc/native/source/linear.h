/* Small vectors, rotations, and symmetric (3, 3) matrices as xx xy xz yy yz zz. */
#ifndef WBC_LINEAR_H
#define WBC_LINEAR_H

#include <math.h>
#include <stdint.h>

/* WIDE compiles a function twice, for wider vectors where the machine has them; INLINE is for what it calls.
 * Results are the same, bit for bit: nothing is reordered or fused. */
#if defined(__x86_64__) && defined(__gnu_linux__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) &&        \
    !defined(WBC_NARROW)
#define WIDE __attribute__((target_clones("avx2", "default")))
#define INLINE static inline __attribute__((always_inline))
#else
#define WIDE
#define INLINE static inline
#endif

/* For loops over arrays that do not overlap, which compilers cannot see of rows of one block. */
#if defined(__GNUC__) && !defined(__clang__)
#define INDEPENDENT _Pragma("GCC ivdep")
#else
#define INDEPENDENT
#endif

static const double PI = 3.14159265358979323846;

/* The next multiple of four: rows padded with zeros to that length need no remainder loop. */
#define PADDED(n) (((n) + 3) & ~(int64_t)3)

/* Four contiguous numbers of any alignment. */
typedef double four __attribute__((vector_size(32), aligned(8), may_alias));
#define FOUR(from) (*(const four *)(from))

static inline double dot3(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Dot product in eight partial sums, which are independent. Written out, since compilers vectorise it better than a
 * loop. */
INLINE double dot(int64_t n, const double *a, const double *b) {
    double p = 0.0, q = 0.0, r = 0.0, s = 0.0, t = 0.0, u = 0.0, v = 0.0, w = 0.0;
    int64_t i = 0;
    for (; i + 8 <= n; i += 8) {
        p += a[i] * b[i], q += a[i + 1] * b[i + 1];
        r += a[i + 2] * b[i + 2], s += a[i + 3] * b[i + 3];
        t += a[i + 4] * b[i + 4], u += a[i + 5] * b[i + 5];
        v += a[i + 6] * b[i + 6], w += a[i + 7] * b[i + 7];
    }
    if (i + 4 <= n) {
        p += a[i] * b[i], q += a[i + 1] * b[i + 1];
        r += a[i + 2] * b[i + 2], s += a[i + 3] * b[i + 3];
        i += 4;
    }
    for (; i < n; i++) t += a[i] * b[i];
    return ((p + t) + (r + v)) + ((q + u) + (s + w));
}

/* to += w a + x b + y d + z e: four rows at a time read and write to a quarter as often. */
INLINE void add_four(int64_t n, const double *c, const double *a, const double *b, const double *d, const double *e,
                     double *restrict to) {
    const double w = c[0], x = c[1], y = c[2], z = c[3];
    if (w == 0.0 && x == 0.0 && y == 0.0 && z == 0.0) return;
    for (int64_t j = 0; j < n; j++) to[j] += (w * a[j] + x * b[j]) + (y * d[j] + z * e[j]);
}

/* to += c'R for k rows of n entries, stride apart. */
INLINE void add_rows(int64_t n, int64_t k, const double *c, const double *rows, int64_t stride, double *restrict to) {
    for (; k >= 4; k -= 4, c += 4, rows += 4 * stride)
        add_four(n, c, rows, rows + stride, rows + 2 * stride, rows + 3 * stride, to);
    const double rest[4] = {k > 0 ? c[0] : 0.0, k > 1 ? c[1] : 0.0, k > 2 ? c[2] : 0.0, 0.0};
    if (k > 0) add_four(n, rest, rows, k > 1 ? rows + stride : rows, k > 2 ? rows + 2 * stride : rows, rows, to);
}

/* The same for k rows by number; of a triangle (ascending numbers) from the diagonal on. */
INLINE void add_numbered(int64_t n, int64_t k, const double *c, const int64_t *number, const double *rows,
                         int triangle, double *restrict to) {
    for (int64_t r = 0; r < k; r += 4) {
        const double *row[4];
        const int64_t begin = triangle ? number[r] : 0;
        double by[4];
        for (int i = 0; i < 4; i++) {
            by[i] = r + i < k ? c[r + i] : 0.0;
            row[i] = rows + number[r + i < k ? r + i : r] * n + begin;
        }
        add_four(n - begin, by, row[0], row[1], row[2], row[3], to + begin);
    }
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
        for (int j = 0; j < 3; j++) out[3 * i + j] = A[i] * B[j] + A[3 + i] * B[3 + j] + A[6 + i] * B[6 + j];
}

/* R (3, 3): the rotation of a unit quaternion x y z w. */
static inline void from_quaternion(const double *xyzw, double *R) {
    const double x = xyzw[0], y = xyzw[1], z = xyzw[2], w = xyzw[3];
    R[0] = 1.0 - 2.0 * (y * y + z * z), R[1] = 2.0 * (x * y - z * w), R[2] = 2.0 * (x * z + y * w);
    R[3] = 2.0 * (x * y + z * w), R[4] = 1.0 - 2.0 * (x * x + z * z), R[5] = 2.0 * (y * z - x * w);
    R[6] = 2.0 * (x * z - y * w), R[7] = 2.0 * (y * z + x * w), R[8] = 1.0 - 2.0 * (x * x + y * y);
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

/* exp(r) = 1 + c[0] [r] + c[1] [r]^2, its integral over time 1 + c[1] [r] + c[2] [r]^2, and the integral of that,
 * 1/2 + c[2] [r] + c[3] [r]^2 (Gamma 0, 1, 2 in the appendix of Hartley et al.). */
static inline void coefficients(const double *r, double *c) {
    const double tt = dot3(r, r);
    if (tt < 0.01) { /* series: the closed form of c[3] loses half its digits, and divisions are slow */
        const double a = tt * (1.0 / 20), b = tt * (1.0 / 30), d = tt * (1.0 / 42), e = tt * (1.0 / 56);
        const double f = tt * (1.0 / 72), g = tt * (1.0 / 90), h = tt * (1.0 / 110), i = tt * (1.0 / 132);
        c[0] = 1.0 - tt * (1.0 / 6) * (1.0 - a * (1.0 - d * (1.0 - f)));
        c[1] = 0.5 * (1.0 - tt * (1.0 / 12) * (1.0 - b * (1.0 - e * (1.0 - g))));
        c[2] = (1.0 / 6) * (1.0 - a * (1.0 - d * (1.0 - f * (1.0 - h))));
        c[3] = (1.0 / 24) * (1.0 - b * (1.0 - e * (1.0 - g * (1.0 - i))));
        return;
    }
    const double t = sqrt(tt);
    c[0] = sin(t) / t;
    c[1] = (1.0 - cos(t)) / tt;
    c[2] = (1.0 - c[0]) / tt;
    c[3] = (0.5 - c[1]) / tt;
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

/* S += [w] M - M [w], the rate of a symmetric M that rotates at w */
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
