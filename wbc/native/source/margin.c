/* The margin between a robot's bodies: the law of wbc/constraints/margin.py, at the torque level
 * within the reach that wbc/controllers/bounded_margins.py says, and the look-ahead of
 * wbc/controllers/look_ahead.py up to where a cut is needed, which is made in Python.
 */
#include "margin.h"
#include "linear.h"
#include "tree.h"

#include <string.h>

/* As in wbc/constraints/margin.py. */
static const double SKIN = 1e-4, USED = 0.5e-4, ROUNDING = 1e-7, INTERIOR = 1e-3, PART = 0.01;
/* As in wbc/constraints/margin.py. */
static const double LEVER = 1.0, ABLE = 1e-6;
/* As in wbc/controllers/bounded_margins.py. */
static const double MARGIN_BRAKING = 20.0;

/* Where the margin's rows begin among all. */
static int64_t first_row(const wbc_plan *plan, const wbc_qp *qp) {
    return qp->m - plan->given_rows - plan->margin->rows;
}

static double smaller(double a, double b) { return a < b ? a : b; }

/* The speed at which a clearance may be used up: see stopping_speed in wbc/braking.py. */
static double approach(const wbc_plan *plan, const double *row, double clearance) {
    const wbc_margin *margin = plan->margin;
    const int64_t n = plan->tree->nv - 6;
    const double dt = plan->dt, left = clearance > 0.0 ? clearance : 0.0;
    double deceleration = margin->deceleration, able = 0.0;
    if (margin->acceleration) {
        for (int64_t j = 0; j < n; j++) able += fabs(row[6 + j]) * margin->acceleration[j];
        if (able > ABLE) deceleration = smaller(able, deceleration);
    }
    const double braked = 2.0 * left / (sqrt(2.0 * left / deceleration + dt * dt) + dt);
    return smaller(braked, margin->gain / dt * left);
}

/* How bodies stop at v. */
static wbc_closing closing_at(const wbc_plan *plan, const double *v, double *twist) {
    const wbc_margin *margin = plan->margin;
    wbc_closing closing = {twist, plan->dt, 0.0, plan->dt / margin->gain, 0.5 / margin->deceleration};
    for (int64_t j = 6; margin->acceleration && j < plan->tree->nv; j++) {
        const double time = fabs(v[j]) / margin->acceleration[j - 6];
        if (time > closing.slowest) closing.slowest = time;
    }
    return closing;
}

/* How the joints move at v: against the base, which changes no distance, if no body is at rest. */
static void add_twists(const wbc_plan *plan, const double *state, const double *v, double *twist) {
    const wbc_pairs *of = plan->margin->of;
    const wbc_tree *tree = plan->tree;
    const int64_t nv = tree->nv;
    const double *T = state + TWISTS(nv);
    int at_rest = 0;
    for (int64_t b = 0; b < of->bodies; b++) at_rest |= of->joint[b] == 0;
    memset(twist, 0, 12 * sizeof *twist);
    for (int64_t c = 0; at_rest && c < 6; c++)
        for (int i = 0; i < 6; i++) twist[6 + i] += T[i * nv + c] * v[c];
    for (int64_t j = 2; j < tree->joints; j++) {
        const double *above = twist + 6 * tree->parent[j], rate = v[tree->iv[j]];
        for (int i = 0; i < 6; i++) twist[6 * j + i] = above[i] + T[i * nv + tree->iv[j]] * rate;
    }
}

int add_margin(const wbc_plan *plan, const double *state, const double *v, double *scratch,
               const wbc_qp *qp) {
    const wbc_margin *margin = plan->margin;
    const int64_t nv = plan->tree->nv, n = qp->n, k = margin->rows, before = first_row(plan, qp);
    double *nearest = scratch, *rows = nearest + 7 * k, *twist = rows + k * nv;
    double *work = twist + 6 * plan->tree->joints;
    const wbc_closing closing = closing_at(plan, v, twist);
    const double now = plan->torque ? MARGIN_BRAKING * plan->dt : INFINITY;
    int64_t *chosen = usual_columns(plan, qp) + most_equalities(plan);
    if (plan->torque) add_twists(plan, state, v, twist);
    const int said = soonest(margin->of, state, k, margin->kept, plan->torque ? &closing : 0, work,
                             chosen, nearest);
    if (said) return said > 0 ? MORE_ROWS : NOT_MEASURED;
    for (int64_t i = 0; i < k; i++)
        if (nearest[i] == -INFINITY) return NOT_MEASURED;
    wbc_pair_rows(margin->of, plan->tree, state, k, chosen, nearest + k, nearest + 4 * k, rows);
    for (int64_t i = 0; i < k; i++) {
        const double *row = rows + i * nv, clearance = nearest[i] - margin->kept[chosen[i]];
        const double reach = plan->torque ? dot(nv, row, v) + now : INFINITY;
        double *to = qp->C + (before + i) * n, least = -approach(plan, row, clearance);
        if (clearance < 0.0) { /* less than the skin is no violation */
            const double lost = -SKIN - clearance > 0.0 ? -SKIN - clearance : 0.0;
            least = smaller(margin->recovery / plan->dt * lost, margin->recovery_speed);
        }
        if (least > 0.0) {
            push(plan, row, smaller(least, reach), 1.0, qp);
            least = -smaller(INTERIOR, PART * least);
        }
        memcpy(to, row, nv * sizeof *to);
        memset(to + nv, 0, (n - nv) * sizeof *to);
        qp->l[before + i] = smaller(least, reach), qp->u[before + i] = INFINITY;
        qp->clearance[i] = clearance, qp->chosen[i] = (double)chosen[i];
    }
    return DONE;
}

/* By how much the joints down to each turn at most over a step: 0 of the world, then sums. */
static void add_turns(const wbc_tree *tree, const double *step, double *turns) {
    turns[0] = 0.0;
    turns[1] = fabs(step[3]) + fabs(step[4]) + fabs(step[5]);
    for (int64_t j = 2; j < tree->joints; j++)
        turns[j] = turns[tree->parent[j]] + fabs(step[tree->iv[j]]);
}

/* How far a pair may end below its linear prediction: quick in wbc/robot/collision/curvature.py. */
static double bend(const wbc_margin *margin, int64_t pair, const double *step,
                   const double *turns) {
    const wbc_pairs *of = margin->of;
    const int64_t *both = of->pair + 2 * pair, common = of->common[pair];
    const double angle =
        turns[of->joint[both[0]]] + turns[of->joint[both[1]]] - 2.0 * turns[common];
    double lever = LEVER * angle; /* while the base slides, its turn curves the path */
    if (common == 0) lever += fabs(step[0]) + fabs(step[1]) + fabs(step[2]);
    return 0.5 * lever * angle + margin->shorter[pair] * angle;
}

/* The pairs that have to be measured where a step leads; returns how many, -1: any may come. */
static int64_t watched(const wbc_plan *plan, const wbc_qp *qp, const double *v,
                       const double *step, double *turns, int64_t *pairs) {
    const wbc_margin *margin = plan->margin;
    const int64_t nv = plan->tree->nv, k = margin->rows, before = first_row(plan, qp);
    double farthest = -INFINITY, way = 0.0;
    int64_t count = 0;
    const wbc_closing closing = closing_at(plan, v, 0);
    for (int64_t i = 0; i < k; i++) { /* no pair without a row is nearer than this: see soonest */
        double left = qp->clearance[i];
        if (plan->torque) left -= stopping_way(&closing, -dot(nv, qp->C + (before + i) * qp->n, v));
        if (left > farthest) farthest = left;
    }
    for (int64_t j = 0; j < nv; j++) way += fabs(step[j]);
    if (k < margin->of->pairs && LEVER * way > farthest) return -1;
    add_turns(plan->tree, step, turns);
    for (int64_t i = 0; i < k; i++) {
        const int64_t pair = (int64_t)qp->chosen[i];
        const double change = dot(nv, qp->C + (before + i) * qp->n, step);
        if (qp->clearance[i] + change - bend(margin, pair, step, turns) < -USED)
            pairs[count++] = pair;
    }
    return count;
}

/* The clearance that a pair had before; infinite without a row. */
static double clearance_of(const wbc_qp *qp, int64_t rows, double pair) {
    for (int64_t i = 0; i < rows; i++)
        if (qp->chosen[i] == pair) return qp->clearance[i];
    return INFINITY;
}

int leads_inside(const wbc_plan *plan, const double *q, const double *v, const wbc_qp *qp,
                 double *scratch, int64_t *pairs) {
    const wbc_margin *margin = plan->margin;
    const wbc_tree *tree = plan->tree;
    const int64_t nv = tree->nv, rows = margin->rows;
    double *step = scratch, *turns = step + nv, *there = turns + tree->joints;
    double *arms = there + 2 * nv, *nearest = arms + 3 * tree->joints, *work = nearest + 7 * rows;
    for (int64_t i = 0; i < nv; i++) step[i] = plan->dt * qp->x[i];
    int64_t k = watched(plan, qp, v, step, turns, pairs);
    if (k == 0) return 0;
    wbc_integrate(tree, q, step, there);
    place_joints(tree, there, plan->state, arms);
    if (k < 0) {
        k = rows;
        if (wbc_nearest(margin->of, plan->state, k, margin->kept, work, pairs, nearest)) return 1;
    } else if (wbc_measure(margin->of, plan->state, k, pairs, work, nearest))
        return 1;
    for (int64_t i = 0; i < k; i++) {
        const double start = clearance_of(qp, rows, (double)pairs[i]) - ROUNDING;
        if (nearest[i] - margin->kept[pairs[i]] < smaller(-USED, start)) return 1;
    }
    return 0;
}
