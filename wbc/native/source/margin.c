/* The margin between a robot's bodies: the law that wbc/constraints/margin.py says, at the torque level
 * within the reach that wbc/constraints/rows.py says, and the look-ahead of
 * wbc/controllers/look_ahead.py up to where a cut is needed, which is made in Python.
 */
#include "margin.h"
#include "linear.h"
#include "tree.h"

#include <string.h>

/* Rows keep this much more than the margin asked for [m], so that the second order, which a linear row leaves
 * out, does not violate the margin itself. One tick may use up half of it. */
const double wbc_skin = 1e-4, wbc_used = 0.5e-4;
const double wbc_rounding = 1e-7; /* m: by how much a violation may grow in one tick */
/* Rows being recovered are relaxed by this speed [m/s], or by this part of the recovery speed, to leave the
 * solver an interior. */
const double wbc_interior = 1e-3, wbc_part = 0.01;
const double wbc_lever = 1.0;           /* m: assumed distance of points from the joints, to estimate curvature */
const double wbc_margin_braking = 20.0; /* m/s^2: the hardest before a margin */
/* rad/s^2: of one joint on the way out of it; by more, a hair's breadth throws a robot about. */
const double wbc_margin_leaving = 5.0;
static const double ABLE = 1e-6; /* m/s^2: below this the joints' accelerations say nothing of a pair */

/* Where the margin's rows begin among all. */
static int64_t first_row(const wbc_plan *plan, const wbc_qp *qp) {
    return qp->m - plan->given_rows - plan->margin->rows;
}

static double smaller(double a, double b) { return a < b ? a : b; }

/* How fast a clearance may change: from -u on, u dt + u^2 / (2 a) <= x and u <= gain x / dt; inside, back. */
static double approach(const wbc_margin *margin, int64_t nv, double dt, const double *row, double clearance) {
    double deceleration = margin->deceleration, able = 0.0;
    if (clearance < 0.0) { /* less than the skin is no violation */
        const double lost = -wbc_skin - clearance > 0.0 ? -wbc_skin - clearance : 0.0;
        return smaller(margin->recovery / dt * lost, margin->recovery_speed);
    }
    if (margin->acceleration) {
        for (int64_t j = 6; j < nv; j++) able += fabs(row[j]) * margin->acceleration[j - 6];
        if (able > ABLE) deceleration = smaller(able, deceleration);
    }
    return -smaller(stopping(clearance, deceleration, dt), margin->gain / dt * clearance);
}

int wbc_approach(const wbc_margin *margin, int64_t nv, double dt, int64_t k, const double *rows,
                 const double *clearance, double *least) {
    for (int64_t i = 0; i < k; i++) least[i] = approach(margin, nv, dt, rows + i * nv, clearance[i]);
    return DONE;
}

/* How bodies stop at v. */
static wbc_closing closing_at(const wbc_plan *plan, const double *v, double *twist) {
    const wbc_margin *margin = plan->margin;
    wbc_closing closing = {twist, margin->of->joint, plan->dt, 0.0, plan->dt / margin->gain, 0.5 / margin->deceleration};
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
    const double now = plan->torque ? wbc_margin_braking * plan->dt : INFINITY;
    int64_t *chosen = usual_columns(plan) + most_equalities(plan);
    if (plan->torque) add_twists(plan, state, v, twist);
    const int said = soonest(margin->of, state, k, margin->kept, plan->torque ? &closing : 0, work,
                             chosen, nearest);
    if (said) return said > 0 ? MORE_ROWS : NOT_MEASURED;
    for (int64_t i = 0; i < k; i++)
        if (nearest[i] == -INFINITY) return NOT_MEASURED;
    wbc_pair_rows(margin->of, plan->tree, state, k, chosen, nearest + k, nearest + 4 * k, rows);
    for (int64_t i = 0; i < k; i++) {
        const double *row = rows + i * nv, clearance = nearest[i] - margin->kept[chosen[i]];
        const double rate = plan->torque ? dot(nv, row, v) : INFINITY, reach = rate + now;
        double *to = qp->C + (before + i) * n, least = approach(margin, nv, plan->dt, row, clearance);
        if (least > 0.0) {
            const double change = wbc_margin_leaving * sqrt(dot(nv - 6, row + 6, row + 6)) * plan->dt;
            double out = smaller(least, smaller(reach, (rate > 0.0 ? rate : 0.0) + change));
            if (plan->torque && out < rate - change) out = rate - change;
            push(plan, row, out, 1.0, qp);
            least = -smaller(wbc_interior, wbc_part * least);
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

/* How far a pair may end below its linear prediction. While two bodies turn against each other by an
 * angle, at most the sum of those between them, the paths of their points curve, which is of second
 * order in it; and where surfaces are parallel the nearest points jump along the shorter one. */
static double bend(const wbc_pairs *of, int64_t pair, const double *step, const double *turns) {
    const int64_t *both = of->pair + 2 * pair, common = of->common[pair];
    const double angle =
        turns[of->joint[both[0]]] + turns[of->joint[both[1]]] - 2.0 * turns[common];
    double lever = wbc_lever * angle; /* while the base slides, its turn curves the path */
    if (common == 0) lever += fabs(step[0]) + fabs(step[1]) + fabs(step[2]);
    return 0.5 * lever * angle + of->shorter[pair] * angle;
}

int wbc_bends(const wbc_pairs *of, const wbc_tree *tree, const double *step, int64_t k, const int64_t *chosen,
              double *turns, double *bends) {
    add_turns(tree, step, turns);
    for (int64_t i = 0; i < k; i++) bends[i] = bend(of, chosen[i], step, turns);
    return DONE;
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
    if (k < margin->of->pairs && wbc_lever * way > farthest) return -1;
    add_turns(plan->tree, step, turns);
    for (int64_t i = 0; i < k; i++) {
        const int64_t pair = (int64_t)qp->chosen[i];
        const double change = dot(nv, qp->C + (before + i) * qp->n, step);
        if (qp->clearance[i] + change - bend(margin->of, pair, step, turns) < -wbc_used)
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
        const double start = clearance_of(qp, rows, (double)pairs[i]) - wbc_rounding;
        if (nearest[i] - margin->kept[pairs[i]] < smaller(-wbc_used, start)) return 1;
    }
    return 0;
}
