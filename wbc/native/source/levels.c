/* A tick with strict priorities, level by level (lexicographic optimisation, Kanoun, Lamiraux & Wieber 2011).
 *
 * What a level achieves for its rows, J x*, is an equality of the levels below; physics, contacts, limits and
 * inequality rows hold on all levels, widened to the solution of the level above, so that rounding makes none
 * infeasible, and soft rows give way by what the first level needs. The command is that of the last level that was
 * solved.
 */
#include "linear.h"
#include "margin.h"
#include "problem.h"
#include "reduce.h"
#include "solve.h"
#include "tree.h"

#include <string.h>

/* Exact velocity of the base, so that its dynamics hold to rounding at the joints' velocities x, and the torques. */
static void command(const wbc_plan *plan, const wbc_qp *qp) {
    const int64_t n = qp->n, nv = plan->tree->nv;
    double missed[6], turn[6], triangle[6 * PADDED(7)];
    for (int i = 0; i < 6; i++) missed[i] = dot(n, qp->D + i * n, qp->x) + qp->offset[i];
    cholesky_solve(6, qp->D, n, missed, triangle, turn); /* the base's inertia * turn = -missed */
    for (int i = 0; i < 6; i++) qp->exact[i] = qp->x[i] + turn[i];
    memcpy(qp->exact + 6, qp->x + 6, (nv - 6) * sizeof *qp->x);
    for (int64_t i = 6; i < nv; i++) {
        const double *row = qp->D + i * n;
        const double sum = dot(6, row, qp->exact) + dot(n - 6, row + 6, qp->x + 6);
        qp->torque[i - 6] = plan->unit * (sum + qp->offset[i]);
    }
}

/* A level below the first has its own QP in plan->below, but for what is the same in all levels. k grows by the
 * rows that the levels above achieve. */
static void lay_out_below(const wbc_plan *plan, const wbc_qp *first, wbc_qp *qp) {
    const int64_t n = first->n, most = most_equalities(plan), m = first->m;
    double *at = plan->below;
    *qp = *first;
    qp->P = at, at += n * n;
    qp->A = at, at += most * n;
    qp->g = at, at += n;
    qp->lower = at, at += n;
    qp->upper = at, at += n;
    qp->b = at, at += most;
    qp->l = at, at += m;
    qp->u = at, at += m;
    qp->x = at, at += n;
    qp->y = at, at += most;
    qp->z = at, at += m;
    qp->z_box = at, at += n;
    qp->found = at;
}

/* The number of equalities of a level: those of the first, and the rows achieved above. */
static int64_t equalities(const wbc_plan *plan, int64_t level) {
    int64_t k = plan->passives + plan->held;
    for (const wbc_block *block = plan->block; block < plan->block + plan->blocks; block++)
        if (!block->held && block->level < level) k += block->rows;
    return k;
}

void lay_out_level(const wbc_plan *plan, int64_t level, wbc_qp *qp) {
    lay_out(plan, qp);
    if (level == 0) return;
    const wbc_qp first = *qp;
    lay_out_below(plan, &first, qp);
    qp->k = equalities(plan, level);
}

int wbc_layout(const wbc_plan *plan, int64_t level, int64_t *at) {
    wbc_qp first, qp;
    lay_out(plan, &first);
    lay_out_level(plan, level, &qp);
    const double *own[] = {qp.P, qp.A, qp.C, qp.g, qp.lower, qp.upper, qp.b,
                           qp.l, qp.u, qp.x, qp.y, qp.z,     qp.z_box, qp.found};
    const double *shared[] = {first.D,     first.offset, first.errors,    first.heaviest,
                              first.exact, first.torque, first.clearance, first.chosen};
    at[0] = qp.n, at[1] = qp.k, at[2] = qp.m;
    for (int i = 0; i < 14; i++) at[3 + i] = own[i] - (level && i != 2 ? plan->below : plan->out);
    for (int i = 0; i < 8; i++) at[17 + i] = shared[i] - plan->out;
    at[25] = first.chosen + margin_rows(plan) - plan->out;
    lay_out_below(plan, &first, &qp);
    at[26] = plan->levels > 1 ? qp.found + 5 - plan->below : 0;
    return DONE;
}

/* Compliance of the inequality rows, (m): of those given by Python only, in the first level. 0: all are hard. */
static const double *user_row_compliance(const wbc_plan *plan, int64_t level, const wbc_qp *qp, double *compliance) {
    if (!plan->soft || level) return 0;
    const int64_t nv = plan->tree->nv, k = plan->given_rows;
    memset(compliance, 0, qp->m * sizeof *compliance);
    memcpy(compliance + qp->m - k, plan->given + k * nv + 2 * k, k * sizeof *compliance);
    return compliance;
}

solve_options solver_options(const wbc_plan *plan, int64_t level, const wbc_qp *qp) {
    int64_t *last_pivots = last_pivots_of(plan), *pairs = last_pivots + most_equalities(plan);
    double *compliance = plan->scratch + plan->solver_end - qp->m; /* at the end of the solver's scratch memory */
    solve_options options = {.compliance = user_row_compliance(plan, level, qp, compliance),
                             .work = pairs,
                             .most = plan->most,
                             .accuracy = 1.0,
                             .pivoted = level > 0};
    if (plan->margin) options.work += plan->margin->of->pairs;
    if (level == 0) {
        options.last_pivots = plan->outside ? last_pivots : 0;
        options.outside = plan->outside && !plan->soft;
        options.always = (int)plan->always;
    } else /* their equalities mix numbers of all levels */
        for (int64_t i = 0; i < qp->n; i++)
            if (fabs(qp->g[i]) + 1.0 > options.accuracy) options.accuracy = fabs(qp->g[i]) + 1.0;
    return options;
}

int wbc_pose(const wbc_plan *plan, const double *q, const double *v, int64_t level) {
    const int64_t n = plan->tree->nv + plan->forces;
    const wbc_costs stored = stored_costs(plan);
    wbc_qp first, above, qp;
    lay_out(plan, &first);
    lay_out_level(plan, level - 1, &above);
    lay_out_level(plan, level, &qp);
    double *x = plan->scratch, *J = x + n; /* of the level above, whose QP is overwritten */
    memcpy(x, above.x, n * sizeof *x);
    memcpy(qp.A, first.A, first.k * n * sizeof *qp.A);
    int64_t k = first.k;
    for (const wbc_block *block = plan->block; block < plan->block + plan->blocks; block++) {
        const double *weight = plan->number + block->number + WEIGHTS;
        for (int64_t i = 0; i < block->rows && !block->held && block->level < level; i++, k++)
            if (weight[i] > 0.0) memcpy(qp.A + k * n, stored.matrix + (block->first + i) * n, n * sizeof *qp.A);
            else /* it has no weight */ memset(qp.A + k * n, 0, n * sizeof *qp.A);
    }
    for (int64_t r = 0; r < k; r++) qp.b[r] = dot(n, qp.A + r * n, x);
    for (int64_t i = 0; i < n; i++) {
        qp.lower[i] = first.lower[i] < x[i] ? first.lower[i] : x[i];
        qp.upper[i] = first.upper[i] > x[i] ? first.upper[i] : x[i];
    }
    for (int64_t r = 0; r < qp.m; r++) {
        const double value = dot(n, qp.C + r * n, x);
        qp.l[r] = value < first.l[r] ? value : first.l[r];
        qp.u[r] = value > first.u[r] ? value : first.u[r];
    }
    double heaviest = 0.0;
    qp.heaviest = &heaviest;
    memset(qp.P, 0, n * n * sizeof *qp.P);
    memset(qp.g, 0, n * sizeof *qp.g);
    add_costs(plan, level, J, qp.P, qp.g, &heaviest);
    v = velocity_of(plan->tree, q, v);
    recover(plan, q, v, &qp);
    finish_cost(plan, level, v, 0.0, J, qp.P, qp.g);
    return is_qp(&qp) ? DONE : NOT_FINITE;
}

int wbc_solve(const wbc_plan *plan, int64_t level) {
    wbc_qp first, qp;
    lay_out(plan, &first);
    lay_out_level(plan, level, &qp);
    const solve_options options = solver_options(plan, level, &qp);
    const int status = solve(&qp, &options, plan->scratch, plan->order);
    if (status == DONE) first.found[4] = (double)(level + 1);
    return status;
}

/* The torques, and whether the command enters a margin. */
int wbc_finish(const wbc_plan *plan, const double *q, const double *v) {
    wbc_qp first, qp;
    v = velocity_of(plan->tree, q, v);
    lay_out(plan, &first);
    lay_out_level(plan, (int64_t)first.found[4] - 1, &qp);
    if (!is_measured(qp.x, plan->tree->nv)) return UNSOLVED; /* not a velocity of a robot */
    if (plan->torque) command(plan, &qp), write_force_errors(plan, &qp);
    int64_t *pairs = last_pivots_of(plan) + most_equalities(plan);
    double *scratch = plan->scratch + plan->solver_end;
    return plan->margin && enters_margin(plan, q, v, &qp, scratch, pairs) ? LEADS_INSIDE : DONE;
}

int solve_below(const wbc_plan *plan, const double *q, const double *v) {
    wbc_qp first;
    lay_out(plan, &first);
    first.found[4] = 1.0;
    for (int64_t level = 1; level < plan->levels; level++) {
        if (wbc_pose(plan, q, v, level) == DONE && wbc_solve(plan, level) == DONE) continue;
        first.found[4] = 1.0; /* the QP of the last level solved was overwritten: solve it again */
        for (int64_t l = 1; l < level; l++)
            if (wbc_pose(plan, q, v, l) != DONE || wbc_solve(plan, l) != DONE) return UNSOLVED;
        break;
    }
    return DONE;
}

int wbc_descend(const wbc_plan *plan, const double *q, const double *v) {
    if (solve_below(plan, q, v) != DONE) return UNSOLVED;
    if (plan->closing) close_loops(plan, q, velocity_of(plan->tree, q, v));
    return wbc_finish(plan, q, v);
}

int wbc_tick(const wbc_plan *plan, const double *state, const void *measured, const double *v) {
    const double *q = measured;
    int status = wbc_problem(plan, state, q, v), closed = 0;
    if (status == DONE)
        status = plan->closing && plan->levels == 1 ? solve_with_loops_closed(plan, q, &closed) : wbc_solve(plan, 0);
    if (status != DONE) return status;
    return closed ? wbc_finish(plan, q, v) : wbc_descend(plan, q, v);
}

int wbc_answer(const wbc_plan *plan, const double *x, const double *z, double scale, int64_t iterations) {
    wbc_qp qp;
    lay_out(plan, &qp);
    const solve_options options = solver_options(plan, 0, &qp);
    const int status = solve_reduced(&qp, &options, plan->scratch, plan->order, x, z, scale, iterations);
    if (status == DONE) qp.found[4] = 1.0;
    return status;
}

int wbc_reduced(const wbc_plan *plan, int64_t *begin) {
    wbc_qp qp;
    reduced r;
    lay_out(plan, &qp);
    restore_reduced(&qp, plan->scratch, plan->order, &r);
    const double *every[] = {r.H, r.f, r.low, r.up, r.rows};
    for (int i = 0; i < 5; i++) begin[i] = every[i] - plan->scratch;
    begin[5] = r.left;
    return DONE;
}
