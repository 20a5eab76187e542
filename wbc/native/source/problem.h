/* Where the QP of a plan lies in its memory, and what a tick is made of. */
#ifndef WBC_PROBLEM_H
#define WBC_PROBLEM_H

#include "core.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* Behind each other in plan->out, in the order in which wbc/controllers/native_memory.py reads. */
void lay_out(const wbc_plan *plan, wbc_qp *qp);

/* In plan->order, behind what solving works in: the columns that were eliminated (k), which last from
 * tick to tick, then numbers of pairs. */
static inline int64_t *usual_columns(const wbc_plan *plan, const wbc_qp *qp) {
    return plan->order + 2 * qp->n + qp->m;
}

/* Whether its numbers are finite, and lower bounds below upper ones. */
int is_qp(const wbc_qp *qp);

/* A measured state, and what was found at it. */
typedef struct {
    const double *state, *q, *v, *frames, *motion, *accelerations;
} wbc_state_at;

#pragma GCC visibility pop

#endif
