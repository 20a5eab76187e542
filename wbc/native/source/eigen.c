/* A symmetric matrix made positive definite by the absolute values of its eigenvalues.
 *
 * Householder tridiagonalisation with accumulated vectors, then QL with implicit shifts (Wilkinson & Reinsch
 * 1971, tred2 and tql2). Vectors are stored as rows, so that rotations run along memory.
 */
#include "linear.h"
#include "problem.h"

#include <math.h>
#include <string.h>

/* Smaller curvatures, by the largest, are raised to this: steps in flat valleys stay finite. */
static const double FLATTEST = 1e-5;
enum { MOST = 60 }; /* iterations per eigenvalue; two or three are usual */

/* Replace V (n, n), symmetric, by the rows of Q', with Q'V Q tridiagonal: diagonal d (n), off-diagonal e (n), e[0]
 * = 0. w (n): scratch. */
WIDE static void tridiagonal(int64_t n, double *restrict V, double *restrict d, double *restrict e,
                             double *restrict w) {
    for (int64_t i = n - 1; i > 0; i--) { /* row i: reflect its first i entries */
        double *u = V + i * n, scale = 0.0, h = 0.0;
        for (int64_t k = 0; k < i; k++) scale += fabs(u[k]);
        if (i == 1 || scale == 0.0) {
            e[i] = u[i - 1], d[i] = 0.0;
            continue;
        }
        for (int64_t k = 0; k < i; k++) u[k] /= scale, h += u[k] * u[k];
        const double f = u[i - 1], g = f > 0.0 ? -sqrt(h) : sqrt(h);
        e[i] = scale * g;
        h -= f * g;
        u[i - 1] = f - g;
        /* w = A u / h, from the lower half in V */
        memset(w, 0, i * sizeof *w);
        for (int64_t j = 0; j < i; j++) {
            const double *row = V + j * n, own = u[j];
            double sum = dot(j, row, u);
            for (int64_t k = 0; k < j; k++) w[k] += own * row[k];
            w[j] += sum + own * row[j];
        }
        for (int64_t j = 0; j < i; j++) w[j] /= h;
        const double K = dot(i, u, w) / (2.0 * h);
        for (int64_t j = 0; j < i; j++) w[j] -= K * u[j];
        for (int64_t j = 0; j < i; j++) {
            double *row = V + j * n;
            const double a = u[j], b = w[j];
            for (int64_t k = 0; k <= j; k++) row[k] -= a * w[k] + b * u[k];
        }
        d[i] = h;
    }
    d[0] = 0.0, e[0] = 0.0;
    for (int64_t i = 0; i < n; i++) { /* the vectors: Q of the first i + 1 unknowns, as rows of Q' */
        const double h = d[i], *u = V + i * n;
        d[i] = V[i * n + i];
        if (h != 0.0)
            for (int64_t j = 0; j < i; j++) { /* row j of Q' times the reflection 1 - u u' / h */
                double *row = V + j * n;
                const double by = dot(i, row, u) / h;
                for (int64_t k = 0; k < i; k++) row[k] -= by * u[k];
            }
        double *own = V + i * n;
        for (int64_t k = 0; k < i; k++) own[k] = 0.0, V[k * n + i] = 0.0;
        own[i] = 1.0;
    }
}

/* Replace the rows of V by eigenvectors, d by eigenvalues; false: no convergence, or NaN. */
WIDE static int diagonal(int64_t n, double *restrict V, double *restrict d, double *restrict e) {
    for (int64_t i = 1; i < n; i++) e[i - 1] = e[i];
    e[n - 1] = 0.0;
    for (int64_t l = 0; l < n; l++)
        for (int steps = 0;; steps++) {
            int64_t m = l;
            while (m < n - 1 && fabs(e[m]) > 1e-16 * (fabs(d[m]) + fabs(d[m + 1]))) m++;
            if (m == l) break;
            if (steps == MOST) return 0;
            double g = (d[l + 1] - d[l]) / (2.0 * e[l]), r = sqrt(g * g + 1.0);
            g = d[m] - d[l] + e[l] / (g + (g >= 0.0 ? r : -r));
            double s = 1.0, c = 1.0, p = 0.0;
            int64_t i = m - 1;
            for (; i >= l; i--) {
                double f = s * e[i], b = c * e[i];
                r = sqrt(f * f + g * g);
                e[i + 1] = r;
                if (r == 0.0) {
                    d[i + 1] -= p, e[m] = 0.0;
                    break;
                }
                s = f / r, c = g / r;
                g = d[i + 1] - p;
                r = (d[i] - g) * s + 2.0 * c * b;
                p = s * r;
                d[i + 1] = g + p;
                g = c * r - b;
                double *restrict one = V + i * n, *restrict other = one + n;
                for (int64_t k = 0; k < n; k++) {
                    const double x = one[k], y = other[k];
                    other[k] = s * x + c * y;
                    one[k] = c * x - s * y;
                }
            }
            if (r == 0.0 && i >= l) continue;
            d[l] -= p, e[l] = g, e[m] = 0.0;
        }
    return 1;
}

WIDE void convexify(int64_t n, double *H, double *work) {
    double *V = work, *d = V + n * n, *e = d + n, most = 0.0;
    memcpy(V, H, n * n * sizeof *V);
    tridiagonal(n, V, d, e, e + n);
    if (!diagonal(n, V, d, e)) return; /* NaN is found when the QP is checked */
    for (int64_t i = 0; i < n; i++)
        if (fabs(d[i]) > most) most = fabs(d[i]);
    memset(H, 0, n * n * sizeof *H);
    for (int64_t i = 0; i < n; i++) { /* V' d V */
        const double size = fabs(d[i]) > FLATTEST * most ? fabs(d[i]) : FLATTEST * most;
        const double *row = V + i * n;
        for (int64_t a = 0; a < n; a++) e[a] = size * row[a];
        for (int64_t a = 0; a < n; a++) {
            double *restrict to = H + a * n;
            const double by = e[a];
            for (int64_t b = a; b < n; b++) to[b] += by * row[b];
        }
    }
    for (int64_t a = 0; a < n; a++)
        for (int64_t b = 0; b < a; b++) H[a * n + b] = H[b * n + a];
}
