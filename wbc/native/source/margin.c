/* The margin between bodies: the law of wbc/constraints/margin.py, at the torque level within the reach of
 * wbc/constraints/rows.py, and the look-ahead of wbc/controllers/look_ahead.py up to where a cut is needed, which
 * Python makes. */
#include "margin.h"
#include "linear.h"
#include "tree.h"

#include <string.h>

/* Rows keep this much more than the margin [m], so that the second order, which linear rows neglect, does not
 * violate the margin itself. One tick may use up half of it. */
const double wbc_skin = 1e-4, wbc_skin_per_tick = 0.5e-4;
const double wbc_rounding = 1e-7; /* m: growth of a violation accepted in one tick */
/* Rows being recovered are relaxed by this speed [m/s], or this share of the recovery speed, to leave the solver an
 * interior. */
const double wbc_interior_speed = 1e-3, wbc_interior_share = 0.01;
const double wbc_lever = 1.0;           /* m: assumed distance of points from the joints, to bound curvature */
const double wbc_margin_braking = 20.0; /* m/s^2: hardest braking before a margin */
/* rad/s^2: of one joint out of a margin; more, and a violation of micrometres throws the robot about. */
const double wbc_margin_leaving = 5.0;
static const double ABLE = 1e-6; /* m/s^2: smaller accelerations by the joints say nothing about a pair */

/* The first margin row among all. */
static int64_t first_row(const wbc_plan *plan, const wbc_qp *qp) {
    return qp->m - plan->given_rows - plan->margin->rows;
}

static double smaller(double a, double b) { return a < b ? a : b; }

/* The slowest rate of a clearance x: -u with u dt + u^2 / (2 a) <= x and u <= gain x / dt; inside, back out. */
static double approach(const wbc_margin *margin, int64_t nv, double dt, const double *row, double clearance) {
    double deceleration = margin->deceleration, able = 0.0;
    if (clearance < 0.0) { /* within the skin nothing is violated */
        const double lost = -wbc_skin - clearance > 0.0 ? -wbc_skin - clearance : 0.0;
        return smaller(margin->recovery / dt * lost, margin->recovery_speed);
    }
    if (margin->acceleration) {
        for (int64_t j = 6; j < nv; j++) able += fabs(row[j]) * margin->acceleration[j - 6];
        if (able > ABLE) deceleration = smaller(able, deceleration);
    }
    return -smaller(stopping_speed(clearance, deceleration, dt), margin->gain / dt * clearance);
}

int wbc_approach(const wbc_margin *margin, int64_t nv, double dt, int64_t k, const double *rows,
                 const double *clearance, double *least) {
    for (int64_t i = 0; i < k; i++) least[i] = approach(margin, nv, dt, rows + i * nv, clearance[i]);
    return DONE;
}

/* How the bodies' motion at v stops. */
static wbc_closing closing_motion(const wbc_plan *plan, const double *v, double *twist) {
    const wbc_margin *margin = plan->margin;
    wbc_closing closing = {twist, margin->of->joint,       plan->dt,
                           0.0,   plan->dt / margin->gain, 0.5 / margin->deceleration};
    for (int64_t j = 6; margin->acceleration && j < plan->tree->nv; j++) {
        const double time = fabs(v[j]) / margin->acceleration[j - 6];
        if (time > closing.slowest) closing.slowest = time;
    }
    return closing;
}

/* Twists of the joints at v; relative to the base, which changes no distance, unless a body is fixed to the world. */
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

int add_margin(const wbc_plan *plan, const double *state, const double *v, double *scratch, const wbc_qp *qp) {
    const wbc_margin *margin = plan->margin;
    const int64_t nv = plan->tree->nv, n = qp->n, k = margin->rows, before = first_row(plan, qp);
    double *nearest = scratch, *rows = nearest + 7 * k, *twist = rows + k * nv;
    double *work = twist + 6 * plan->tree->joints;
    const wbc_closing closing = closing_motion(plan, v, twist);
    const double now = plan->torque ? wbc_margin_braking * plan->dt : INFINITY;
    int64_t *chosen = last_pivots_of(plan) + most_equalities(plan);
    if (plan->torque) add_twists(plan, state, v, twist);
    const int status =
        most_urgent_pairs(margin->of, state, k, margin->kept, plan->torque ? &closing : 0, work, chosen, nearest);
    if (status) return status > 0 ? MORE_ROWS : NOT_MEASURED;
    for (int64_t i = 0; i < k; i++)
        if (nearest[i] == -INFINITY) return NOT_MEASURED;
    wbc_pair_rows(margin->of, plan->tree, state, k, chosen, nearest + k, nearest + 4 * k, rows);
    for (int64_t i = 0; i < k; i++) {
        const double *row = rows + i * nv, clearance = nearest[i] - margin->kept[chosen[i]];
        const double reach = plan->torque ? dot(nv, row, v) + now : INFINITY;
        double *to = qp->C + (before + i) * n, least = approach(margin, nv, plan->dt, row, clearance);
        if (least > 0.0) least = -smaller(wbc_interior_speed, wbc_interior_share * least);
        memcpy(to, row, nv * sizeof *to);
        memset(to + nv, 0, (n - nv) * sizeof *to);
        qp->l[before + i] = smaller(least, reach), qp->u[before + i] = INFINITY;
        qp->clearance[i] = clearance, qp->chosen[i] = (double)chosen[i];
    }
    return DONE;
}

int recovers_margin(const wbc_plan *plan, const double *v, const wbc_qp *qp, int64_t k, const double **row,
                    double *rate) {
    const wbc_margin *margin = plan->margin;
    const int64_t nv = plan->tree->nv;
    *row = qp->C + (first_row(plan, qp) + k) * qp->n;
    double out = approach(margin, nv, plan->dt, *row, qp->clearance[k]);
    if (out <= 0.0) return 0;
    if (plan->torque) {
        const double change = wbc_margin_leaving * sqrt(dot(nv - 6, *row + 6, *row + 6)) * plan->dt;
        const double now = dot(nv, *row, v), reach = now + wbc_margin_braking * plan->dt;
        out = smaller(out, smaller(reach, (now > 0.0 ? now : 0.0) + change));
        if (out < now - change) out = now - change;
    }
    *rate = out;
    return 1;
}

/* How far each joint turns at most over a step: sums from the world outwards. */
static void accumulate_turns(const wbc_tree *tree, const double *step, double *turns) {
    turns[0] = 0.0;
    turns[1] = fabs(step[3]) + fabs(step[4]) + fabs(step[5]);
    for (int64_t j = 2; j < tree->joints; j++) turns[j] = turns[tree->parent[j]] + fabs(step[tree->iv[j]]);
}

/* How far a pair may end below its linear prediction. While two bodies turn against each other by an angle (at most
 * the sum over the joints between them), their points move on curves, of second order in it; and between parallel
 * surfaces the nearest points jump along the shorter one. */
static double curvature_bound(const wbc_pairs *of, int64_t pair, const double *step, const double *turns) {
    const int64_t *both = of->pair + 2 * pair, common = of->common[pair];
    const double angle = turns[of->joint[both[0]]] + turns[of->joint[both[1]]] - 2.0 * turns[common];
    double lever = wbc_lever * angle; /* while the base translates, its rotation curves the path */
    if (common == 0) lever += fabs(step[0]) + fabs(step[1]) + fabs(step[2]);
    return 0.5 * lever * angle + of->shorter[pair] * angle;
}

int wbc_curvature_bounds(const wbc_pairs *of, const wbc_tree *tree, const double *step, int64_t k,
                         const int64_t *chosen, double *turns, double *bounds) {
    accumulate_turns(tree, step, turns);
    for (int64_t i = 0; i < k; i++) bounds[i] = curvature_bound(of, chosen[i], step, turns);
    return DONE;
}

/* Write the pairs that have to be measured where a step leads; returns how many, -1: any pair. */
static int64_t pairs_to_check(const wbc_plan *plan, const wbc_qp *qp, const double *v, const double *step,
                              double *turns, int64_t *pairs) {
    const wbc_margin *margin = plan->margin;
    const int64_t nv = plan->tree->nv, k = margin->rows, before = first_row(plan, qp);
    double farthest = -INFINITY, way = 0.0;
    int64_t count = 0;
    const wbc_closing closing = closing_motion(plan, v, 0);
    for (int64_t i = 0; i < k; i++) { /* pairs without a row are not nearer than this: see most_urgent_pairs */
        double left = qp->clearance[i];
        if (plan->torque) left -= stopping_distance(&closing, -dot(nv, qp->C + (before + i) * qp->n, v));
        if (left > farthest) farthest = left;
    }
    for (int64_t j = 0; j < nv; j++) way += fabs(step[j]);
    if (k < margin->of->pairs && wbc_lever * way > farthest) return -1;
    accumulate_turns(plan->tree, step, turns);
    for (int64_t i = 0; i < k; i++) {
        const int64_t pair = (int64_t)qp->chosen[i];
        const double change = dot(nv, qp->C + (before + i) * qp->n, step);
        if (qp->clearance[i] + change - curvature_bound(margin->of, pair, step, turns) < -wbc_skin_per_tick)
            pairs[count++] = pair;
    }
    return count;
}

int enters_margin(const wbc_plan *plan, const double *q, const double *v, const wbc_qp *qp, double *scratch,
                  int64_t *pairs) {
    const wbc_margin *margin = plan->margin;
    const wbc_tree *tree = plan->tree;
    const int64_t nv = tree->nv, all = margin->of->pairs;
    double *step = scratch, *turns = step + nv, *there = turns + tree->joints;
    double *arms = there + 2 * nv, *limit = arms + 3 * tree->joints, *work = limit + all;
    for (int64_t i = 0; i < nv; i++) step[i] = plan->dt * qp->x[i];
    const int64_t k = pairs_to_check(plan, qp, v, step, turns, pairs);
    if (k == 0) return 0;
    wbc_integrate(tree, q, step, there);
    place_joints(tree, there, plan->state, arms);
    for (int64_t p = 0; p < all && k < 0; p++) limit[p] = margin->kept[p] - wbc_skin_per_tick;
    for (int64_t i = 0; i < margin->rows; i++) { /* those that were nearer may stay so */
        const int64_t pair = (int64_t)qp->chosen[i];
        limit[pair] = margin->kept[pair] + smaller(-wbc_skin_per_tick, qp->clearance[i] - wbc_rounding);
    }
    return any_nearer(margin->of, plan->state, k, pairs, limit, work);
}
