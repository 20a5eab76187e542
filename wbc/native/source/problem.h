/* Where the QP of a plan lies in its memory, and what a tick is made of. */
#ifndef WBC_PROBLEM_H
#define WBC_PROBLEM_H

#include "core.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* Behind each other in plan->out, in the order in which wbc/controllers/native_memory.py reads. */
void lay_out(const wbc_plan *plan, wbc_qp *qp);

/* In plan->order, behind what reduce works in: the columns that were eliminated (k), which last from
 * tick to tick, then numbers of pairs, then what the active-set method works in. */
static inline int64_t *usual_columns(const wbc_plan *plan, const wbc_qp *qp) {
    return plan->order + 2 * qp->n + qp->k + 1;
}

/* Whether its numbers are finite, and lower bounds below upper ones. */
int is_qp(const wbc_qp *qp);

/* Write the primal, dual and complementarity residual of the answer to found. gradient (n): of the
 * Lagrangian without A'y, which is added; give (m), or 0: how far rows C give way by their
 * multipliers. */
void residuals(const wbc_qp *qp, const double *give, double *gradient);

/* Write x (n) of least 1/2 x'H x + f'x, H (n, n) symmetric, of which the upper half is read, its rows
 * stride apart; by Cholesky factors in triangle (n, padded n + 1). False: H is not positive definite. */
int least(int64_t n, const double *H, int64_t stride, const double *f, double *triangle, double *x);

/* P += J' J on and above the diagonal, g -= J' wanted: rows (nv) that are weighted already, P and g of
 * n unknowns. */
void square(int64_t nv, int64_t rows, const double *restrict J, const double *wanted,
            double *restrict P, int64_t n, double *restrict g);

/* Add a block of GIVEN rows to the costs; J holds rows (n) and as many numbers more. */
void add_given(const wbc_plan *plan, const wbc_block *block, double *J, const wbc_qp *qp);

/* Write the errors of GIVEN rows that are about the answer itself. */
void decide_errors(const wbc_plan *plan, const wbc_qp *qp);

/* A measured state, and what was found at it. */
typedef struct {
    const double *state, *q, *v, *frames, *motion, *accelerations;
} wbc_state_at;

#pragma GCC visibility pop

#endif
