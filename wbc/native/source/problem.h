/* Where the QP of a plan lies in its memory, and what a tick is made of. */
#ifndef WBC_PROBLEM_H
#define WBC_PROBLEM_H

#include "core.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* Behind each other in plan->out, in the order in which wbc/controllers/native_memory.py reads. */
void lay_out(const wbc_plan *plan, wbc_qp *qp);

/* Whether its numbers are finite, and lower bounds below upper ones. */
int is_qp(const wbc_qp *qp);

/* A measured state, and what was found at it. */
typedef struct {
    const double *state, *q, *v, *frames, *motion, *accelerations;
} wbc_state_at;

#pragma GCC visibility pop

#endif
