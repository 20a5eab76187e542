/* A QP solved: its equalities eliminated (reduce.c), what is left by the active-set method unless the
 * optimum of the cost alone keeps all bounds, and the answer judged by the KKT residuals of the full QP,
 * those that wbc/qp/kkt.py computes. And the QP of a plain tick, with what a command needs besides.
 */
#include "active_set.h"
#include "linear.h"
#include "margin.h"
#include "reduce.h"
#include "tree.h"

#include <string.h>

/* The velocity at x with a base's that meets its dynamics to rounding, and the torques at that. */
static void command(const wbc_plan *plan, const wbc_qp *qp) {
    const int64_t n = qp->n, nv = plan->tree->nv;
    double missed[6], turn[6], triangle[6 * PADDED(7)];
    for (int i = 0; i < 6; i++) missed[i] = dot(n, qp->D + i * n, qp->x) + qp->offset[i];
    least(6, qp->D, n, missed, triangle, turn); /* the base's inertia times turn = -missed */
    for (int i = 0; i < 6; i++) qp->exact[i] = qp->x[i] + turn[i];
    memcpy(qp->exact + 6, qp->x + 6, (nv - 6) * sizeof *qp->x);
    for (int64_t i = 6; i < nv; i++) {
        const double *row = qp->D + i * n;
        const double sum = dot(6, row, qp->exact) + dot(n - 6, row + 6, qp->x + 6);
        qp->torque[i - 6] = plan->unit * (sum + qp->offset[i]);
    }
}

/* Whether the optimum of the cost alone keeps all bounds and rows: then it is the optimum. */
WIDE static int is_kept(const reduced *r, int64_t bounded) {
    if (!least(r->left, r->H, r->left, r->f, r->triangle, r->answer)) return 0;
    for (int64_t i = 0; i < bounded; i++) {
        const int64_t row = i - r->left;
        const double value =
            row < 0 ? r->answer[i] : dot(r->left, r->rows + row * r->left, r->answer);
        if (!(value >= r->low[i] && value <= r->up[i])) return 0;
        r->multipliers[i] = 0.0;
    }
    return 1;
}

/* Solve what is left; give (m), or 0: how far rows C give way by their multipliers. Returns the
 * iterations, or why there is no answer. */
static int64_t ask(const reduced *r, int64_t bounded, const double *give, int64_t rows,
                   int64_t most, int64_t *order) {
    double *every = r->end; /* of bounds, which do not give way, and rows */
    memset(every, 0, bounded * sizeof *every);
    if (give) memcpy(every + r->left, give, rows * sizeof *give);
    return active_set_solve(r->left, bounded, r->H, r->f, r->rows, r->low, r->up, every, most,
                            every + bounded, order, r->answer, r->multipliers);
}

/* Why there is no answer, with a certificate where no point meets all rows. */
static int fail(const wbc_qp *qp, const reduced *r, int64_t said, int reduced) {
    qp->found[3] = (double)said;
    if (said != NO_POINT) return UNSOLVED;
    if (reduced)
        lift_certificate(qp, r);
    else { /* of the equalities alone, which wrote y */
        memset(qp->z, 0, qp->m * sizeof *qp->z);
        memset(qp->z_box, 0, qp->n * sizeof *qp->z_box);
    }
    return INFEASIBLE;
}

/* x, y, z, z of the box, the three residuals and the number of iterations of a QP. */
static int conclude(const wbc_qp *qp, const reduced *r, const double *give, int64_t iterations) {
    lift(qp, r);
    residuals(qp, give, r->gradient);
    qp->found[3] = (double)iterations;
    for (int i = 0; i < 3; i++)
        if (!(qp->found[i] <= qp->eps)) return UNSOLVED; /* NaN is not */
    return DONE;
}

/* What a tick is made of besides, and where it leads. */
static int finish(const wbc_plan *plan, const double *q, const double *v, const wbc_qp *qp,
                  const reduced *r) {
    if (!is_measured(qp->x, plan->tree->nv)) return UNSOLVED; /* no robot's velocity */
    if (plan->torque) command(plan, qp), decide_errors(plan, qp);
    int64_t *pairs = usual_columns(plan, qp) + qp->k;
    return plan->margin && leads_inside(plan, q, v, qp, r->end, pairs) ? LEADS_INSIDE : DONE;
}

/* Where the active-set method works: behind the columns that were eliminated and the pairs. */
static int64_t *active_columns(const wbc_plan *plan, const wbc_qp *qp) {
    return usual_columns(plan, qp) + qp->k + (plan->margin ? plan->margin->of->pairs : 0);
}

int wbc_answer(const wbc_plan *plan, const double *q, const double *v, const double *x,
               const double *z, double scale, int64_t iterations) {
    wbc_qp qp;
    reduced r;
    v = velocity_of(plan->tree, q, v);
    lay_out(plan, &qp);
    resume(&qp, plan->scratch, plan->order, &r);
    const int64_t bounded = bounds_left(&qp, &r), rows = bounded - r.left;
    if (x) {
        memcpy(r.answer, x, r.left * sizeof *x);
        for (int64_t i = 0; i < r.left; i++) r.multipliers[i] = z[rows + i] / scale;
        for (int64_t i = 0; i < rows; i++) r.multipliers[r.left + i] = z[i] / scale;
    } else {
        iterations = ask(&r, bounded, 0, 0, plan->most, active_columns(plan, &qp));
        if (iterations < 0) return fail(&qp, &r, iterations, 1);
    }
    if (conclude(&qp, &r, 0, iterations) != DONE) return UNSOLVED;
    return finish(plan, q, v, &qp, &r);
}

int wbc_tick(const wbc_plan *plan, const double *state, const double *q, const double *v) {
    v = velocity_of(plan->tree, q, v);
    const int found = wbc_problem(plan, state, q, v);
    if (found != DONE) return found;
    wbc_qp qp;
    reduced r;
    lay_out(plan, &qp);
    place(&qp, plan->scratch, plan->order, &r);
    const int64_t bounded = reduce(&qp, &r, plan->outside ? usual_columns(plan, &qp) : 0, 0);
    if (bounded < 0) return fail(&qp, &r, bounded, 0);
    if (!plan->always && is_kept(&r, bounded) && conclude(&qp, &r, 0, 0) == DONE)
        return finish(plan, q, v, &qp, &r);
    qp.found[0] = (double)(bounded - r.left);
    return plan->outside ? REDUCED : wbc_answer(plan, q, v, 0, 0, 1.0, 0);
}

int wbc_reduced(const wbc_plan *plan, int64_t *begin) {
    wbc_qp qp;
    reduced r;
    lay_out(plan, &qp);
    resume(&qp, plan->scratch, plan->order, &r);
    const double *every[] = {r.H, r.f, r.low, r.up, r.rows};
    for (int i = 0; i < 5; i++) begin[i] = every[i] - plan->scratch;
    begin[5] = r.left;
    return DONE;
}

int wbc_sizes(int64_t n, int64_t k, int64_t m, int64_t *sizes) {
    sizes[0] = reduced_numbers(n, k, m) + n + m + active_set_numbers(n, n + m);
    sizes[1] = reduced_integers(n, k) + 3 * (n + m);
    return DONE;
}

int wbc_solve_qp(const wbc_qp *qp, const double *give, int64_t most, double *scratch,
                 int64_t *order) {
    if (!is_qp(qp)) return NOT_FINITE;
    reduced r;
    place(qp, scratch, order, &r);
    const int64_t bounded = reduce(qp, &r, 0, 1);
    if (bounded < 0) return fail(qp, &r, bounded, 0);
    const int64_t iterations =
        ask(&r, bounded, give, qp->m, most, order + reduced_integers(qp->n, qp->k));
    return iterations < 0 ? fail(qp, &r, iterations, 1) : conclude(qp, &r, give, iterations);
}
