/* A QP without its equalities: what is left of it, and the whole answer from that of the rest. */
#ifndef WBC_REDUCE_H
#define WBC_REDUCE_H

#include "core.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* What is left of a QP without its equalities, in scratch memory. */
typedef struct {
    int64_t rank;          /* of A: unknowns x_d, and rows that are no others' sum */
    int64_t left;          /* unknowns x_i: order[rank..n) */
    int64_t coupled;       /* of them, the first: those on which some x_d depends */
    int64_t stride;        /* of rows of G and half: left, padded */
    int64_t *order;        /* x_d, then x_i */
    int64_t *touched;      /* (n) columns of A that are not 0 */
    int64_t *row;          /* (k) rows of A in the order in which they were eliminated */
    double *W;             /* (k, padded n + 1): to eliminate in */
    double *inverse, *h;   /* (rank, rank): of A_d; (rank): x_d = G x_i + h */
    double *G, *half;      /* (rank, stride) each */
    double *H, *f;         /* (left, left), (left) */
    double *low, *up;      /* (left + m + rank): bounds, C, then the bounded x_d */
    double *rows;          /* (m + rank, left) */
    double *multipliers, *answer;
    double *factor;        /* (k) */
    double *gradient;      /* (n), of the full QP */
    double *triangle;      /* (left, padded left + 1): see least */
    double *end;           /* of the memory */
} reduced;

/* Lay it out in scratch memory of reduced_numbers and reduced_integers; all behind G once rank is known. */
void place(const wbc_qp *qp, double *scratch, int64_t *order, reduced *r);
int64_t reduced_numbers(int64_t n, int64_t k, int64_t m);
int64_t reduced_integers(int64_t n, int64_t k);

/* Leave the QP without its equalities; returns the number of its bounds and rows, or NO_POINT if
 * they contradict each other: then qp->y says by which combination. usual, or 0: of each row of A the
 * column that it had, plus one. pivoted: rows may nearly repeat each other. */
int64_t reduce(const wbc_qp *qp, reduced *r, int64_t *usual, int pivoted);

/* The part of that which needs A and b alone: order, G, h and the inverse of A_d. Returns 0, or NO_POINT. */
int64_t solve_equalities(const wbc_qp *qp, reduced *of, int64_t *usual, int pivoted);

/* Whether reduce left something in that memory, and what. */
int is_reduced(const wbc_qp *qp, const int64_t *order);
void resume(const wbc_qp *qp, double *scratch, int64_t *order, reduced *r);

/* The same QP with other ends b, behind resume: what depends on them is worked out again. Ends of rows that
 * follow from others become what those give. */
void renew(const wbc_qp *qp, reduced *r);

/* How many bounds and rows are left. */
int64_t bounds_left(const wbc_qp *qp, const reduced *r);

/* Write x of the full QP from the answer of the reduced one. */
void lift_point(const wbc_qp *qp, const reduced *r);
/* Write x, y, z, z_box of the full QP from the answer of the reduced one, and P x + g + z + C'z. */
void lift(const wbc_qp *qp, const reduced *r);
/* Write y, z, z_box from r->gradient P x + g, to which z_box + C'z is added. */
void lift_multipliers(const wbc_qp *qp, const reduced *r);
/* Write y, z, z_box of the full QP from a certificate of the reduced one that no point meets all rows. */
void lift_certificate(const wbc_qp *qp, const reduced *r);

#pragma GCC visibility pop

#endif
