/* A QP without what closed loops and gears determine: unknowns that their rows move, and the forces in them. */
#ifndef WBC_FOLD_H
#define WBC_FOLD_H

#include "core.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

static inline int is_bounded(const wbc_qp *qp, int64_t i) {
    return qp->upper[i] < INFINITY || qp->lower[i] > -INFINITY;
}

typedef struct {
    wbc_qp rest;                /* what is left; the QP itself where nothing was taken out */
    int64_t count, loops;       /* unknowns taken out; of them, the first: velocities, the others: forces */
    int64_t *column, *row;      /* (count) those unknowns, and the equalities by which they go */
    int64_t *kept, *others;     /* (rest.n), (rest.k) the others */
    int64_t *run;               /* the same: where some lie behind each other, how many; then 0, 0; v+ before forces */
    int64_t *support;           /* (supports) unknowns of rest on which those velocities depend */
    int64_t supports;
    double *by;                 /* (supports, loops), and of forces (loops, rest.n): x_e by x of rest, */
    double *force, *shift;      /* but for shift (count) */
    double *inverse;            /* (loops, loops) of the loops' rows, in those velocities */
    double *entry;              /* (rest.k, count) of them in the other rows A */
    double *gradient;           /* (n): see unfold_point */
    double *scratch;            /* behind */
    int64_t *order;
} folded;

/* What that needs, of a plan with rows of loops or gears. */
int64_t folded_numbers(int64_t n, int64_t k, int64_t m);
int64_t folded_integers(int64_t n, int64_t k);

/* Rows of loops and gears among those that are held, which lie one behind the other; where they begin. */
int64_t mechanics(const wbc_plan *plan, int64_t *first);

/* Take out what the loops of a plan determine (0: nothing). usual as in reduce, of the loops' rows. */
void fold(const wbc_qp *qp, const wbc_plan *plan, int64_t *usual, double *scratch, int64_t *order, folded *f);
/* Only which they are. */
void choose_folded(const wbc_qp *qp, const wbc_plan *plan, int64_t *usual, double *scratch, int64_t *order, folded *f);
/* The same, where it has been done in that memory. */
void find_folded(const wbc_qp *qp, const wbc_plan *plan, double *scratch, int64_t *order, folded *f);
/* Write x of the QP by that of rest, P x + g to f->gradient, and what that is in rest (n). */
void unfold_point(const wbc_qp *qp, const folded *f, double *gradient);
/* Write y, z, z_box by those of rest; z_box + C'z is added to f->gradient, P x + g or, of a certificate, 0. */
void unfold(const wbc_qp *qp, const folded *f);

#pragma GCC visibility pop

#endif
