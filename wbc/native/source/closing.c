/* Gears and loops at the end of a tick of the velocity level.
 *
 * Their rows are linear, and mechanisms bend: at 1 rad/s a bar of 0.3 m misses its pin by 4 um after
 * 5 ms. So the tick looks where its command leads, lets the rows give what they missed, too, and is solved
 * again, until loops are closed there: Newton's method with the tick's own matrices, whose factors are
 * there. A QP that has no answer with these ends keeps those that it had.
 */
#include "problem.h"
#include "reduce.h"

#include <string.h>

const double wbc_closed = 1e-10;  /* m, rad: smaller gaps at the end of a tick stay */
const double wbc_far_open = 1.0;  /* m, rad: a larger gap is no matter of curvature */

/* Write how far loops are open where x leads from the tick's state; whether they are to be closed. */
static int is_open(const wbc_plan *plan, const double *q, const double *x, double *gaps) {
    double worst = 0.0;
    wbc_gaps(plan, plan->state, q, x, gaps);
    for (int64_t r = 0; r < plan->held; r++)
        if (!(fabs(gaps[r]) <= worst)) worst = fabs(gaps[r]); /* NaN is not */
    return worst > wbc_closed && worst < wbc_far_open;
}

static void change_ends(const wbc_plan *plan, const wbc_qp *qp, const double *gaps, double sign) {
    const double by = sign / plan->dt;
    for (int64_t r = 0; r < plan->held; r++) qp->b[plan->passives + r] -= by * gaps[r];
}

/* A tick, how many rounds there were, and whether the last was taken back. */
typedef struct {
    const wbc_plan *plan;
    const double *q;
    int *rounds, *undone;
} closing_at;

static int correct_ends(const void *at, const wbc_qp *qp, double *gaps, int undo) {
    const closing_at *of = at;
    if (undo) *of->undone = 1;
    if (!undo && (++*of->rounds > CLOSING_ROUNDS || !is_open(of->plan, of->q, qp->x, gaps))) return 0;
    change_ends(of->plan, qp, gaps, undo ? -1.0 : 1.0);
    return 1;
}

int solve_closed(const wbc_plan *plan, const double *q, int *closed) {
    int rounds = 0, undone = 0;
    const closing_at at = {plan, q, &rounds, &undone};
    wbc_qp qp;
    lay_out(plan, &qp);
    solving how = how_to(plan, 0, &qp);
    how.correct = correct_ends, how.at = &at, how.change = plan->scratch + plan->solving;
    const int said = solve(&qp, &how, plan->scratch, plan->order);
    if (said == DONE) qp.found[4] = 1.0;
    *closed = rounds > 0 && !undone && qp.found[3] == 0.0;
    return said;
}

/* The velocity that the last level commands. */
static const double *commanded(const wbc_plan *plan, const wbc_qp *first) {
    wbc_qp last;
    lay_out_level(plan, (int64_t)first->found[4] - 1, &last);
    return last.x;
}

/* Let the first level be solved again by what its last solution left, or make it ready for that. */
static int is_ready(const wbc_plan *plan, const wbc_qp *first) {
    if (plan->levels == 1 && !plan->always && is_reduced(first, plan->order)) return DONE;
    return prepare(first, plan->scratch, plan->order);
}

static int answer_again(const wbc_plan *plan, const double *q, const double *v, const wbc_qp *first) {
    const solving how = how_to(plan, 0, first);
    if (solve_again(first, &how, plan->scratch, plan->order) != DONE) return UNSOLVED;
    first->found[4] = 1.0;
    return plan->levels > 1 ? solve_below(plan, q, v) : DONE;
}

/* Numbers of the first level's answer, which lie one behind the other. */
static int64_t answer_size(const wbc_qp *first) { return first->found + 5 - first->x; }

void close_loops(const wbc_plan *plan, const double *q, const double *v) {
    wbc_qp first;
    lay_out(plan, &first);
    double *gaps = plan->scratch + plan->solving, *ends = gaps + plan->held;
    double *answer = ends + first.k;
    for (int round = 0; round < CLOSING_ROUNDS; round++) {
        if (!is_open(plan, q, commanded(plan, &first), gaps)) return;
        if (is_ready(plan, &first) != DONE) return;
        memcpy(ends, first.b, first.k * sizeof *ends);
        memcpy(answer, first.x, answer_size(&first) * sizeof *answer);
        change_ends(plan, &first, gaps, 1.0);
        if (answer_again(plan, q, v, &first) == DONE) continue;
        memcpy(first.b, ends, first.k * sizeof *ends);
        memcpy(first.x, answer, answer_size(&first) * sizeof *answer);
        if (plan->levels > 1) solve_below(plan, q, v);
        return;
    }
}
