/* A QP without its equalities: what is left of it, and the whole answer from that of the rest. */
#ifndef WBC_REDUCE_H
#define WBC_REDUCE_H

#include "core.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

static const int64_t NO_ANSWER = -100, NO_POINT = -1; /* NO_POINT: DAQP's exit flag as well */

/* What is left of a QP without its equalities, in scratch memory. */
typedef struct {
    int64_t left;          /* unknowns x_i: order[k..n) */
    int64_t coupled;       /* of them, the first: those on which some x_d depends; set by reduce */
    int64_t stride;        /* of rows of G and half: left, padded */
    int64_t *order;        /* x_d, then x_i */
    double *W;             /* (k, padded n + 1): to eliminate in */
    double *inverse, *h;   /* (k, k): of A_d; (k): x_d = G x_i + h */
    double *G, *half;      /* (k, stride) each */
    double *H, *f;         /* (left, left), (left) */
    double *low, *up;      /* (left + m + k): bounds, C, then the bounded x_d */
    double *rows;          /* (m + k, left) */
    double *multipliers, *answer;
    double *factor;        /* (k) */
    double *gradient;      /* (n), of the full QP */
    double *triangle;      /* (left, padded left + 1): see least */
    double *end;           /* of the memory */
    int *sense;
} reduced;

/* Lay it out in scratch memory; see wbc_solve_qp for its size. */
void place(const wbc_qp *qp, double *scratch, int64_t *order, reduced *r);

/* Leave the QP without its equalities; returns the number of its bounds and rows, or NO_ANSWER if
 * dependent rows leave next to nothing of one, NO_POINT if it contradicts them. usual, or 0: of each
 * row of A the column that it had, plus one. */
int64_t reduce(const wbc_qp *qp, reduced *r, int64_t *usual);

/* How many bounds and rows are left. */
int64_t bounds_left(const wbc_qp *qp, const reduced *r);

/* Write x, y, z, z_box of the full QP from the answer of the reduced one, and P x + g + z + C'z. */
void lift(const wbc_qp *qp, const reduced *r);

#pragma GCC visibility pop

#endif
