/* The QP of a tick: where it lies in the plan's memory, and the steps that write it. */
#ifndef WBC_PROBLEM_H
#define WBC_PROBLEM_H

#include "core.h"
#include "linear.h"
#include "solve.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* The largest speed u with u wait + u^2 / (2 deceleration) <= distance: held for that wait, then braked. */
static inline double stopping_speed(double distance, double deceleration, double wait) {
    return 2.0 * distance / (sqrt(2.0 * distance / deceleration + wait * wait) + wait);
}

/* The parts of the QP lie behind each other in plan->out; wbc_layout says where. */
void lay_out(const wbc_plan *plan, wbc_qp *qp);

/* Add costs for violated margins and joints outside their limits: to each level, or a lower one undoes them. */
void recover(const wbc_plan *plan, const double *q, const double *v, const wbc_qp *qp);

/* Of any level's QP: physics and contacts, and what the levels above achieve. */
static inline int64_t most_equalities(const wbc_plan *plan) {
    return plan->passives + plan->held + (plan->levels > 1 ? plan->costs : 0);
}

/* In plan->order, behind the scratch memory of loop elimination and reduction: the pivots' columns (k), kept from
 * tick to tick; then numbers of pairs; then the scratch memory of the active-set method. */
static inline int64_t *last_pivots_of(const wbc_plan *plan) { return plan->order + plan->last_pivots; }

/* Whether all numbers are finite and no lower bound is above the upper one. */
int is_qp(const wbc_qp *qp);

/* Write primal, dual and complementarity residual to found. gradient (n): of the Lagrangian without A'y, which is
 * added; compliance: as in solve_options. */
void residuals(const wbc_qp *qp, const double *compliance, double *gradient);

/* gradient += P x */
INLINE void add_slope(const wbc_qp *qp, const double *x, double *restrict gradient) {
    const int64_t n = qp->n, wide = qp->wide;
    add_rows(wide, wide, x, qp->P, n, gradient); /* P is symmetric */
    for (int64_t i = wide; i < n; i++) gradient[i] += qp->P[i * (n + 1)] * x[i];
}

/* Write x (n) that minimises 1/2 x'H x + f'x; H (n, n) is symmetric, its upper half is read, rows are stride apart.
 * triangle (n, padded n + 1) gets the Cholesky factors. False: H is not positive definite. */
int cholesky_solve(int64_t n, const double *H, int64_t stride, const double *f, double *triangle, double *x);
/* The same for another f, with the factors that cholesky_solve left. */
void cholesky_solve_again(int64_t n, const double *f, double *triangle, double *x);

/* P += J'J on and above the diagonal (and next to it below), g -= J' wanted; J: weighted rows (nv); P and g have n
 * unknowns. */
void add_squares(int64_t nv, int64_t rows, const double *restrict J, const double *wanted, double *restrict P,
                 int64_t n, double *restrict g);

/* Add the cost of one level, or of all (-1), stored in plan->rows, to the upper half of P (n, n) and to g, and
 * write the largest square of a weighted row to heaviest. J: scratch for the rows (n) of a block, twice. */
void add_costs(const wbc_plan *plan, int64_t level, double *J, double *P, double *g, double *heaviest);
/* Finish a cost: lower half, curvature, damping. */
void finish_cost(const wbc_plan *plan, int64_t level, const double *v, double damping, double *work, double *P,
                 double *g);

/* The parts of plan->rows. */
typedef struct {
    double *matrix, *target, *bias, *damping, *curvature;
} wbc_costs;
static inline wbc_costs stored_costs(const wbc_plan *plan) {
    const int64_t nv = plan->tree->nv, n = nv + plan->forces, k = plan->costs;
    wbc_costs at = {plan->rows, 0, 0, 0, 0};
    at.target = at.matrix + k * n, at.bias = at.target + k, at.damping = at.bias + k;
    at.curvature = at.damping + plan->levels * nv;
    return at;
}

/* Whether a block is about forces; write the moments of a COP block; add a block of forces to the costs (J: scratch
 * for its rows (n), twice). */
static inline int is_of_forces(const wbc_block *block) { return block->kind == GIVEN || block->kind == COP; }
void add_moments(const wbc_plan *plan, const wbc_block *block, const double *frames);
void add_force_rows(const wbc_plan *plan, const wbc_block *block, double *J, const wbc_qp *qp);

/* Close loops and gears where the command leads, by Newton's method on the first level; lower levels follow. */
void close_loops(const wbc_plan *plan, const double *q, const double *v);
/* Solve the only level so that they are closed. closed: whether the unconstrained optimum stayed feasible. */
int solve_with_loops_closed(const wbc_plan *plan, const double *q, int *closed);
/* Solve the levels below the first. DONE, or UNSOLVED. */
int solve_below(const wbc_plan *plan, const double *q, const double *v);
/* The QP of a level in memory, and the options it is solved with. */
void lay_out_level(const wbc_plan *plan, int64_t level, wbc_qp *qp);
solve_options solver_options(const wbc_plan *plan, int64_t level, const wbc_qp *qp);

/* Write the errors of the rows about forces, which the solution determines. */
void write_force_errors(const wbc_plan *plan, const wbc_qp *qp);

/* Make H (n, n) positive definite by the absolute values of its eigenvalues, as in a saddle-free Newton method
 * (Dauphin et al. 2014). work holds n (n + 3) numbers. */
void convexify(int64_t n, double *H, double *work);

/* A measured state and the kinematics there. */
typedef struct {
    const double *state, *q, *v, *frames, *motion, *accelerations;
} wbc_state_at;

#pragma GCC visibility pop

#endif
