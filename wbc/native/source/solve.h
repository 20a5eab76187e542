/* How a QP is solved. */
#ifndef WBC_SOLVE_H
#define WBC_SOLVE_H

#include "core.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

typedef struct {
    const double *give; /* (m), or 0: how far rows C give way by their multipliers */
    const wbc_plan *loops; /* or 0: whose loops and gears are taken out first; then its ends cannot be changed */
    int64_t *usual;     /* (k), or 0: of each equality the column that was eliminated last time, plus 1 */
    int64_t *work;      /* 3 (n + m), for the active-set method, and its iterations at most */
    int64_t most;
    double accuracy;    /* residuals may be this times eps */
    int pivoted;        /* whether equalities may nearly repeat each other */
    int outside;        /* whether others solve what is left: REDUCED */
    int always;         /* whether it is solved where the optimum of the cost alone would do, too */
    /* or 0: by x of the QP changes its ends b, for it to be solved again; false if there is no need. undo:
     * takes the last change back. */
    int (*correct)(const void *at, const wbc_qp *qp, double *change, int undo);
    const void *at;
    double *change; /* (k) */
} solving;

/* Write the answer of a QP: DONE, UNSOLVED, INFEASIBLE or REDUCED. Then, scratch and order as they were
 * left, its answer from that of the reduced QP; x 0: by the active-set method. */
int solve(const wbc_qp *qp, const solving *how, double *scratch, int64_t *order);
int solve_reduced(const wbc_qp *qp, const solving *how, double *scratch, int64_t *order,
                  const double *x, const double *z, double scale, int64_t iterations);
/* Make ready to solve a QP again; then, as often as its ends b are changed, scratch and order as they were
 * left, write its answer: DONE, or why there is none. */
int prepare(const wbc_qp *qp, double *scratch, int64_t *order);
int solve_again(const wbc_qp *qp, const solving *how, double *scratch, int64_t *order);

#pragma GCC visibility pop

#endif
