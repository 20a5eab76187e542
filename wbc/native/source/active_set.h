/* Who solves QPs in which rows may give way. */
#ifndef WBC_ACTIVE_SET_H
#define WBC_ACTIVE_SET_H

#include <stdint.h>

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* Minimise 1/2 x'H x + f'x + 1/2 sum s^2 / give subject to low <= (x, R x) - s <= up, s = 0 where
 * give is 0. n unknowns, m - n rows R; low, up, give and the multipliers z (m) are of x, then of
 * R x. Returns the number of iterations, at most most; -1: no answer. scratch holds 2 n + 10 m + 2 n^2
 * + m n + m (m - 1) / 2 numbers, order 3 m. */
int64_t active_set_solve(int64_t n, int64_t m, const double *H, const double *f,
                         const double *rows, const double *low, const double *up,
                         const double *give, int64_t most, double *scratch, int64_t *order,
                         double *x, double *z);

#pragma GCC visibility pop

#endif
