/* Where the QP of a plan lies in its memory, and what a tick is made of. */
#ifndef WBC_PROBLEM_H
#define WBC_PROBLEM_H

#include "core.h"
#include "linear.h"
#include "solve.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* The largest speed u with u wait + u^2 / (2 deceleration) <= distance: it is held for a while, then braked. */
static inline double stopping(double distance, double deceleration, double wait) {
    return 2.0 * distance / (sqrt(2.0 * distance / deceleration + wait * wait) + wait);
}

/* Behind each other in plan->out; wbc_layout says where. */
void lay_out(const wbc_plan *plan, wbc_qp *qp);

/* A dominating cost that asks a row (nv) for a rate, weight times as heavy as others of its kind. */
void push(const wbc_plan *plan, const double *row, double rate, double weight, const wbc_qp *qp);

/* Of a level's QP: those of the contacts and of physics, and what the levels above achieve. */
static inline int64_t most_equalities(const wbc_plan *plan) {
    return plan->passives + plan->held + (plan->levels > 1 ? plan->costs : 0);
}

/* In plan->order, behind what fold and reduce work in: the columns that were eliminated (k), which last from
 * tick to tick, then numbers of pairs, then what the active-set method works in. */
static inline int64_t *usual_columns(const wbc_plan *plan) { return plan->order + plan->usual; }

/* Whether its numbers are finite, and lower bounds below upper ones. */
int is_qp(const wbc_qp *qp);

/* Write the primal, dual and complementarity residual of the answer to found. gradient (n): of the
 * Lagrangian without A'y, which is added; give (m), or 0: how far rows C give way by their
 * multipliers. */
void residuals(const wbc_qp *qp, const double *give, double *gradient);

/* gradient += P x */
INLINE void add_slope(const wbc_qp *qp, const double *x, double *restrict gradient) {
    const int64_t n = qp->n, wide = qp->wide;
    add_rows(wide, wide, x, qp->P, n, gradient); /* P is symmetric */
    for (int64_t i = wide; i < n; i++) gradient[i] += qp->P[i * (n + 1)] * x[i];
}

/* Write x (n) of least 1/2 x'H x + f'x, H (n, n) symmetric, of which the upper half is read, its rows
 * stride apart; by Cholesky factors in triangle (n, padded n + 1). False: H is not positive definite. */
int least(int64_t n, const double *H, int64_t stride, const double *f, double *triangle, double *x);
/* The same for another f, by the factors that least left. */
void least_again(int64_t n, const double *f, double *triangle, double *x);

/* P += J' J on and above the diagonal, and anything just before it, g -= J' wanted: rows (nv) that are weighted
 * already, P and g of n unknowns. */
void square(int64_t nv, int64_t rows, const double *restrict J, const double *wanted,
            double *restrict P, int64_t n, double *restrict g);

/* Write the cost of one level, or of all (-1), that was kept in plan->rows, to the upper half of P (n, n)
 * and to g, and the largest square of a weighted row to heaviest. J holds the rows (n) of a block, and as
 * many numbers more. */
void add_costs(const wbc_plan *plan, int64_t level, double *J, double *P, double *g,
                  double *heaviest);
/* What is left to do for a cost: its lower half, curvature, damping. */
void close_cost(const wbc_plan *plan, int64_t level, const double *v, double damping, double *work,
                double *P, double *g);

/* What plan->rows holds. */
typedef struct {
    double *matrix, *target, *bias, *damping, *curvature;
} wbc_costs;
static inline wbc_costs kept_costs(const wbc_plan *plan) {
    const int64_t nv = plan->tree->nv, n = nv + plan->forces, k = plan->costs;
    wbc_costs at = {plan->rows, 0, 0, 0, 0};
    at.target = at.matrix + k * n, at.bias = at.target + k, at.damping = at.bias + k;
    at.curvature = at.damping + plan->levels * nv;
    return at;
}

/* Whether a block is about forces; write the moments of a COP block; add one to the costs, J holds rows (n) and
 * as many numbers more. */
static inline int is_of_forces(const wbc_block *block) { return block->kind == GIVEN || block->kind == COP; }
void add_moments(const wbc_plan *plan, const wbc_block *block, const double *frames);
void add_force_rows(const wbc_plan *plan, const wbc_block *block, double *J, const wbc_qp *qp);

/* Close loops and gears where the command leads, by Newton's method; the answers of all levels follow. */
void close_loops(const wbc_plan *plan, const double *q, const double *v);
/* Solve the only level so that they are closed, where the optimum of its cost alone keeps all bounds: writes
 * whether that was so. */
int solve_closed(const wbc_plan *plan, const double *q, int *closed);
/* The levels below the first. DONE, or UNSOLVED. */
int solve_below(const wbc_plan *plan, const double *q, const double *v);
/* The QP of a level as it lies in memory, and how it is solved. */
void lay_out_level(const wbc_plan *plan, int64_t level, wbc_qp *qp);
solving how_to(const wbc_plan *plan, int64_t level, const wbc_qp *qp);

/* Write the errors of rows of forces, which are about the answer itself. */
void decide_errors(const wbc_plan *plan, const wbc_qp *qp);

/* H (n, n) becomes the nearest matrix that a QP can use: its eigenvalues made positive, as in a
 * saddle-free Newton method (Dauphin et al. 2014). work holds n (n + 3) numbers. */
void convexify(int64_t n, double *H, double *work);

/* A measured state, and what was found at it. */
typedef struct {
    const double *state, *q, *v, *frames, *motion, *accelerations;
} wbc_state_at;

#pragma GCC visibility pop

#endif
