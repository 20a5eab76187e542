/* Where the QP of a plan lies in its memory, and what a tick is made of. */
#ifndef WBC_PROBLEM_H
#define WBC_PROBLEM_H

#include "core.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* minimise 1/2 x'P x + g'x subject to A x = b, l <= C x <= u, lower <= x <= upper; n unknowns, k
 * equalities, m rows. D, offset: base forces and torques by x, at the torque level. */
typedef struct {
    int64_t n, k, m;
    double *P, *A, *C, *D, *offset, *g, *lower, *upper, *b, *l, *u;
    double *errors, *heaviest;         /* of the costs; the largest square of a weighted row */
    double *x, *y, *z, *z_box, *found; /* as wbc_solve writes them */
    double *exact, *torque;            /* (6), (nv - 6): see command in source/solve.c */
} wbc_qp;

/* Behind each other in plan->out, in the order in which wbc/controllers/native_memory.py reads. */
void lay_out(const wbc_plan *plan, wbc_qp *qp);

/* A measured state, and what was found at it. */
typedef struct {
    const double *state, *q, *v, *frames, *motion, *accelerations;
} wbc_state_at;

#pragma GCC visibility pop

#endif
