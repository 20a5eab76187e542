/* Rows that keep bodies apart, and whether an answer does. */
#ifndef WBC_MARGIN_H
#define WBC_MARGIN_H

#include "problem.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* How many rows a plan has for them. */
static inline int64_t margin_rows(const wbc_plan *plan) {
    return plan->margin ? plan->margin->rows : 0;
}

/* Write the rows of a margin behind all others; what is inside it adds a cost to the upper half of
 * P and to g. False: some pair was not measured. */
int add_margin(const wbc_plan *plan, const double *state, const double *v, double *scratch,
               const wbc_qp *qp);

/* Whether the velocity found leads from q into the margin, or to where it cannot be measured;
 * plan->state is lost, and so is the scratch. */
int leads_inside(const wbc_plan *plan, const double *q, const wbc_qp *qp);

#pragma GCC visibility pop

#endif
