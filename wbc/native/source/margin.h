/* Rows that keep bodies apart, and whether an answer does. */
#ifndef WBC_MARGIN_H
#define WBC_MARGIN_H

#include "problem.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* What a pair needs to stop in that closes at a speed. */
static inline double stopping_way(const wbc_closing *closing, double speed) {
    const double braking = closing->half * speed;
    const double wait = closing->dt + (braking > closing->slowest ? braking : closing->slowest);
    return speed > 0.0 ? speed * (wait > closing->least ? wait : closing->least) : 0.0;
}

/* As wbc_nearest, of least distance less kept and, unless closing is 0, what they need to stop in.
 * Returns 1, too: more than count may not stop in time. */
int soonest(const wbc_pairs *of, const double *state, int64_t count, const double *kept,
            const wbc_closing *closing, double *scratch, int64_t *chosen, double *nearest);

/* How many rows a plan has for them. */
static inline int64_t margin_rows(const wbc_plan *plan) {
    return plan->margin ? plan->margin->rows : 0;
}

/* Write the rows of a margin behind all others; what is inside it adds a cost to the upper half of
 * P and to g. Returns DONE, or why it is handed over. */
int add_margin(const wbc_plan *plan, const double *state, const double *v, double *scratch,
               const wbc_qp *qp);

/* Whether the velocity found leads from q, where it was v, into the margin, or to where it cannot
 * be measured; plan->state is lost. scratch holds 3 nv + 4 joints + 7 numbers a row and what
 * wbc_measure needs, pairs one each. */
int leads_inside(const wbc_plan *plan, const double *q, const double *v, const wbc_qp *qp,
                 double *scratch, int64_t *pairs);

#pragma GCC visibility pop

#endif
