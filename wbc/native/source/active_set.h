/* Dual active-set method for QPs whose rows may be soft. */
#ifndef WBC_ACTIVE_SET_H
#define WBC_ACTIVE_SET_H

#include <stdint.h>

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* Returned in place of the number of iterations. NO_POINT: infeasible, with a certificate. */
static const int64_t NO_POINT = -1, NO_ANSWER = -100;

/* Minimise 1/2 x'H x + f'x + 1/2 sum s^2 / compliance subject to low <= (x, R x) - s <= up, s = 0 where compliance
 * is 0. n unknowns, m - n rows R; low, up, compliance and the multipliers z (m) are of x, then of R x. Returns the
 * number of iterations, at most most, or one of the above. After NO_POINT z is a Farkas certificate: z'(x, R x) is
 * 0 for all x, the sum of z times the bounds it points at (up where positive, low where negative) is below 0, and
 * no row of it can be left out. scratch holds active_set_numbers(n, m), order 3 m. */
int64_t active_set_solve(int64_t n, int64_t m, const double *H, const double *f, const double *rows,
                         const double *low, const double *up, const double *compliance, int64_t most, double *scratch,
                         int64_t *order, double *x, double *z);
int64_t active_set_numbers(int64_t n, int64_t m);

#pragma GCC visibility pop

#endif
