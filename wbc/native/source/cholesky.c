/* The unconstrained optimum, H x = -f, by Cholesky factors U'U = H. */
#include "linear.h"
#include "problem.h"

#include <math.h>
#include <string.h>

/* Four rows at a time, from the end: the sums over known entries are independent of each other. */
INLINE void back_substitute(int64_t n, int64_t width, const double *triangle, double *x) {
    for (int64_t end = n; end > 0; end = (end - 1) & ~(int64_t)3) {
        const int64_t begin = (end - 1) & ~(int64_t)3;
        for (int64_t i = begin; i < end; i++) {
            const double *row = triangle + i * width;
            x[i] = row[n] - dot(n - end, row + end, x + end);
        }
        for (int64_t i = end - 1; i >= begin; i--) {
            const double *row = triangle + i * width;
            for (int64_t j = end - 1; j > i; j--) x[i] -= row[j] * x[j];
            x[i] *= row[i];
        }
    }
}

WIDE int cholesky_solve(int64_t n, const double *H, int64_t stride, const double *f, double *triangle, double *x) {
    const int64_t width = PADDED(n + 1); /* U with its diagonal inverted, and behind it U'^-1 (-f) */
    for (int64_t i = 0; i < n; i++) {
        const int64_t begin = i & ~(int64_t)3; /* up to three unused entries */
        double *restrict row = triangle + i * width;
        for (int64_t j = begin; j < i; j++) row[j] = 0.0;
        memcpy(row + i, H + i * stride + i, (n - i) * sizeof *row);
        row[n] = -f[i];
        for (int64_t j = n + 1; j < width; j++) row[j] = 0.0;
        for (int64_t k = 0; k < i; k++) x[k] = -triangle[k * width + i];
        add_rows(width - begin, i, x, triangle + begin, width, row + begin);
        if (!(row[i] > 0.0)) return 0;
        const double scale = 1.0 / sqrt(row[i]);
        for (int64_t j = begin; j < width; j++) row[j] *= scale;
        row[i] = scale;
    }
    back_substitute(n, width, triangle, x);
    return 1;
}

WIDE void cholesky_solve_again(int64_t n, const double *f, double *triangle, double *x) {
    const int64_t width = PADDED(n + 1);
    for (int64_t i = 0; i < n; i++) x[i] = -f[i];
    for (int64_t i = 0; i < n; i += 4) { /* four rows, then their part of all others */
        const int64_t behind = i + 4 < n ? i + 4 : n;
        double end[4] = {0.0, 0.0, 0.0, 0.0};
        for (int64_t j = i; j < behind; j++) {
            double *row = triangle + j * width;
            row[n] = x[j] * row[j], end[j - i] = -row[n];
            for (int64_t k = j + 1; k < behind; k++) x[k] += end[j - i] * row[k];
        }
        add_rows(n - behind, behind - i, end, triangle + i * width + behind, width, x + behind);
    }
    back_substitute(n, width, triangle, x);
}
