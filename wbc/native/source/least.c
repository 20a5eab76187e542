/* The optimum of a cost without constraints: H x = -f by Cholesky factors U'U = H. */
#include "linear.h"
#include "problem.h"

#include <math.h>
#include <string.h>

INLINE void back_substitute(int64_t n, int64_t width, const double *triangle, double *x) {
    for (int64_t i = n - 1; i >= 0; i--) {
        const double *row = triangle + i * width;
        x[i] = (row[n] - dot(n - 1 - i, row + i + 1, x + i + 1)) * row[i];
    }
}

WIDE int least(int64_t n, const double *H, int64_t stride, const double *f, double *triangle,
               double *x) {
    const int64_t width = PADDED(n + 1); /* U, its diagonal inverted, and behind it U'^-1 (-f) */
    for (int64_t i = 0; i < n; i++) {
        const int64_t begin = i & ~(int64_t)3; /* up to three entries that nobody reads */
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

WIDE void least_again(int64_t n, const double *f, double *triangle, double *x) {
    const int64_t width = PADDED(n + 1);
    for (int64_t i = 0; i < n; i++) x[i] = -f[i];
    for (int64_t i = 0; i < n; i++) {
        double *row = triangle + i * width;
        const double end = row[n] = x[i] * row[i];
        for (int64_t j = i + 1; j < n; j++) x[j] -= end * row[j];
    }
    back_substitute(n, width, triangle, x);
}
