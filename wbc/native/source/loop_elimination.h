/* A QP without the velocities that closed loops and gears determine, and without the forces in them. */
#ifndef WBC_LOOP_ELIMINATION_H
#define WBC_LOOP_ELIMINATION_H

#include "core.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

static inline int is_bounded(const wbc_qp *qp, int64_t i) {
    return qp->upper[i] < INFINITY || qp->lower[i] > -INFINITY;
}

typedef struct {
    wbc_qp remaining;      /* the QP that is left; the QP itself where nothing is eliminated */
    int64_t count, loops;  /* number of eliminated unknowns; of velocities among them, which come first, then
                                 * forces */
    int64_t *column, *row; /* (count) these unknowns, and the equalities that eliminate them */
    int64_t *columns_left, *rows_left; /* (remaining.n), (remaining.k) columns and rows that are left */
    int64_t *run;     /* columns_left as runs: first, length; ends with 0, 0; no run holds both v+ and
                                 * forces */
    int64_t *support; /* (supports) remaining unknowns on which those velocities depend */
    int64_t supports;
    double *velocity_map;       /* (supports, loops), and of forces (loops, remaining.n): eliminated
                                           * unknowns */
    double *force_map, *offset; /* are map * remaining + offset (count) */
    double *inverse;            /* (loops, loops): N, of the loops' rows in those velocities */
    double *entry;              /* (remaining.k, count): their entries in the other rows of A */
    double *gradient;           /* (n): see lift_loop_point */
    double *scratch;            /* for all else */
    int64_t *order;
} loop_elimination;

/* Scratch memory for a plan with rows of loops or gears. */
int64_t loop_elimination_numbers(int64_t n, int64_t k, int64_t m);
int64_t loop_elimination_integers(int64_t n, int64_t k);

/* Number of equalities that are rows of loops and gears, which lie one behind the other; first: the first of them. */
int64_t loop_rows_held(const wbc_plan *plan, int64_t *first);

/* Eliminate what the loops of a plan (or 0: nothing) determine. last_pivots: as in reduce, of the loops' rows. */
void eliminate_loops(const wbc_qp *qp, const wbc_plan *plan, int64_t *last_pivots, double *scratch, int64_t *order,
                     loop_elimination *f);
/* Only choose the unknowns and equalities. */
void choose_loop_pivots(const wbc_qp *qp, const wbc_plan *plan, int64_t *last_pivots, double *scratch, int64_t *order,
                        loop_elimination *f);
/* Find the result of either in that memory again. */
void restore_loop_elimination(const wbc_qp *qp, const wbc_plan *plan, double *scratch, int64_t *order,
                              loop_elimination *f);
/* Write x of the QP from that of the remaining one, P x + g to f->gradient, and its reduction to gradient (n). */
void lift_loop_point(const wbc_qp *qp, const loop_elimination *f, double *gradient);
/* Write y, z, z_box from those of the remaining QP; z_box + C'z is added to f->gradient, which is P x + g or, for a
 * certificate, 0. */
void lift_loop_multipliers(const wbc_qp *qp, const loop_elimination *f);

#pragma GCC visibility pop

#endif
