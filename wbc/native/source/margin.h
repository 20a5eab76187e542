/* Rows that keep bodies apart, and the check of the solution. */
#ifndef WBC_MARGIN_H
#define WBC_MARGIN_H

#include "problem.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* The stopping distance of a pair that closes at a speed. */
static inline double stopping_distance(const wbc_closing *closing, double speed) {
    const double braking = closing->half * speed;
    const double wait = closing->dt + (braking > closing->slowest ? braking : closing->slowest);
    return speed > 0.0 ? speed * (wait > closing->least ? wait : closing->least) : 0.0;
}

/* As wbc_nearest, of least clearance minus, unless closing is 0, the stopping distance. Returns 1, too: more than
 * count may not stop in time. */
int most_urgent_pairs(const wbc_pairs *of, const double *state, int64_t count, const double *kept,
                      const wbc_closing *closing, double *scratch, int64_t *chosen, double *nearest);

/* Whether any of k pairs, or, with k < 0, of all, is nearer than its limit (pairs); also where that is unknown. scratch
 * holds 9 numbers a body and 1 a pair. */
int any_nearer(const wbc_pairs *of, const double *state, int64_t k, const int64_t *chosen, const double *limit,
               double *scratch);

/* Number of margin rows of a plan. */
static inline int64_t margin_rows(const wbc_plan *plan) { return plan->margin ? plan->margin->rows : 0; }

/* Write the margin's rows behind all others. Returns DONE, or why Python has to take over. */
int add_margin(const wbc_plan *plan, const double *state, const double *v, double *scratch, const wbc_qp *qp);
/* Whether the margin's row k is violated; writes where it is, and the least rate that recovers it. */
int recovers_margin(const wbc_plan *plan, const double *v, const wbc_qp *qp, int64_t k, const double **row,
                    double *rate);

/* Whether the solution leads from q, where the velocity was v, into the margin, or to where distances are unknown;
 * plan->state is overwritten. scratch holds 3 nv + 4 joints + 9 bodies + 2 pairs numbers, pairs one each. */
int enters_margin(const wbc_plan *plan, const double *q, const double *v, const wbc_qp *qp, double *scratch,
                  int64_t *pairs);

#pragma GCC visibility pop

#endif
