/* The solution of one QP: elimination, factorization, active-set method. */
#ifndef WBC_SOLVE_H
#define WBC_SOLVE_H

#include "core.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

typedef struct {
    const double *compliance; /* (m), or 0: compliance of rows C, slack = compliance * multiplier */
    int64_t *last_pivots;     /* (k), or 0: of each equality the column eliminated in the last tick, plus 1 */
    int64_t *work;            /* 3 (n + m), for the active-set method, and its largest number of iterations */
    int64_t most;
    double accuracy; /* residuals of up to accuracy * eps are accepted */
    int pivoted;     /* choose rows by their pivots, too: equalities may be nearly dependent */
    int outside;     /* leave the reduced QP to an external solver: REDUCED */
    int always;      /* ask the solver even where the unconstrained optimum is feasible */
    /* or 0: change b by the solution x, to solve again; false: no need. undo: take the last change back. */
    int (*correct)(const void *at, const wbc_qp *qp, double *change, int undo);
    const void *at;
    double *change; /* (k) */
} solve_options;

/* Solve a QP. Returns DONE, UNSOLVED, INFEASIBLE or REDUCED. solve_reduced goes on after REDUCED, with scratch and
 * order as solve left them, from the solution x, z of the reduced QP; x 0: by the active-set method. */
int solve(const wbc_qp *qp, const solve_options *options, double *scratch, int64_t *order);
int solve_reduced(const wbc_qp *qp, const solve_options *options, double *scratch, int64_t *order, const double *x,
                  const double *z, double scale, int64_t iterations);
/* Factorize a QP; then solve it again whenever b was changed, scratch and order as they were left. Returns DONE, or
 * why there is no solution. */
int factorize(const wbc_qp *qp, double *scratch, int64_t *order);
int solve_again(const wbc_qp *qp, const solve_options *options, double *scratch, int64_t *order);

#pragma GCC visibility pop

#endif
