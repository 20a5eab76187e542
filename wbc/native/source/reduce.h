/* A QP reduced by its equalities, and the full solution from the reduced one. */
#ifndef WBC_REDUCE_H
#define WBC_REDUCE_H

#include "core.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* The reduced QP, in scratch memory. */
typedef struct {
    int64_t rank;        /* of A: number of dependent unknowns x_d, and of independent rows */
    int64_t left;        /* number of free unknowns x_i: order[rank..n) */
    int64_t coupled;     /* how many of them, the first ones, some x_d depends on */
    int64_t stride;      /* of rows of G and half: left, padded */
    int64_t *order;      /* x_d, then x_i */
    int64_t *touched;    /* (n) columns of A that are not 0 */
    int64_t *row;        /* (k) rows of A in the order of elimination */
    double *W;           /* (k, padded n + 1): the augmented matrix */
    double *inverse, *h; /* (rank, rank): A_d^-1; (rank): x_d = G x_i + h */
    double *G, *half;    /* (rank, stride) each */
    double *H, *f;       /* (left, left), (left) */
    double *low, *up;    /* (left + m + rank): bounds, C, then the bounded x_d */
    double *rows;        /* (m + rank, left) */
    double *multipliers, *answer;
    double *factor;   /* (k) */
    double *gradient; /* (n), of the full QP */
    double *triangle; /* (left, padded left + 1): see cholesky_solve */
    double *end;      /* of the memory */
} reduced;

/* Lay it out in scratch memory of reduced_numbers and reduced_integers; what lies behind G once the rank is known. */
void lay_out_reduced(const wbc_qp *qp, double *scratch, int64_t *order, reduced *r);
int64_t reduced_numbers(int64_t n, int64_t k, int64_t m);
int64_t reduced_integers(int64_t n, int64_t k);

/* Reduce the QP. Returns the number of its bounds and rows, or NO_POINT if the equalities contradict each other:
 * then qp->y is the certificate. last_pivots, or 0: of each row of A the column of its last pivot, plus 1. pivoted:
 * rows may be nearly dependent. */
int64_t reduce(const wbc_qp *qp, reduced *r, int64_t *last_pivots, int pivoted);

/* Whether that memory holds a reduced QP; and find it there. */
int is_reduced(const wbc_qp *qp, const int64_t *order);
void restore_reduced(const wbc_qp *qp, double *scratch, int64_t *order, reduced *r);

/* The same QP for another b, after restore_reduced. b of dependent rows becomes what the others imply. */
void update_right_hand_side(const wbc_qp *qp, reduced *r);

/* Number of bounds and rows of the reduced QP. */
int64_t bounds_left(const wbc_qp *qp, const reduced *r);

/* Write x of the full QP from the reduced solution. */
void lift_point(const wbc_qp *qp, const reduced *r);
/* Write x, y, z, z_box of the full QP from the reduced solution, and P x + g + z + C'z to r->gradient. */
void lift(const wbc_qp *qp, const reduced *r);
/* Write the certificate y, z, z_box of the full QP from that of the reduced one. */
void lift_certificate(const wbc_qp *qp, const reduced *r);

#pragma GCC visibility pop

#endif
