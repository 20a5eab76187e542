/* Closing gears and loops at the end of a tick of the velocity level.
 *
 * Their rows are linear, the mechanisms are not: at 1 rad/s a bar of 0.3 m misses its pin by 4 um after 5 ms.
 * So the tick evaluates the gaps where its command leads, adds them to the rows' right-hand sides, and solves
 * again until the loops are closed there: Newton's method with the factors of the tick. If the QP has no
 * solution with the new right-hand sides, the old ones and their solution stay.
 */
#include "problem.h"
#include "reduce.h"

#include <string.h>

const double wbc_closed = 1e-10; /* m, rad: smaller gaps at the end of a tick are left */
const double wbc_far_open = 1.0; /* m, rad: larger gaps are not due to curvature */

/* Write the gaps of the loops where x leads; returns whether they are to be closed. */
static int is_open(const wbc_plan *plan, const double *q, const double *x, double *gaps) {
    double worst = 0.0;
    wbc_gaps(plan, plan->state, q, x, gaps);
    for (int64_t r = 0; r < plan->held; r++)
        if (!(fabs(gaps[r]) <= worst)) worst = fabs(gaps[r]); /* NaN is not */
    return worst > wbc_closed && worst < wbc_far_open;
}

static void shift_right_hand_sides(const wbc_plan *plan, const wbc_qp *qp, const double *gaps, double sign) {
    const double by = sign / plan->dt;
    for (int64_t r = 0; r < plan->held; r++) qp->b[plan->passives + r] -= by * gaps[r];
}

/* A tick, the rounds so far, and whether the last one was undone. */
typedef struct {
    const wbc_plan *plan;
    const double *q;
    int *rounds, *undone;
} closure_context;

static int correct_right_hand_sides(const void *at, const wbc_qp *qp, double *gaps, int undo) {
    const closure_context *of = at;
    if (undo) *of->undone = 1;
    if (!undo && (++*of->rounds > CLOSING_ROUNDS || !is_open(of->plan, of->q, qp->x, gaps))) return 0;
    shift_right_hand_sides(of->plan, qp, gaps, undo ? -1.0 : 1.0);
    return 1;
}

int solve_with_loops_closed(const wbc_plan *plan, const double *q, int *closed) {
    int rounds = 0, undone = 0;
    const closure_context at = {plan, q, &rounds, &undone};
    wbc_qp qp;
    lay_out(plan, &qp);
    solve_options options = solver_options(plan, 0, &qp);
    options.correct = correct_right_hand_sides, options.at = &at, options.change = plan->scratch + plan->solver_end;
    const int status = solve(&qp, &options, plan->scratch, plan->order);
    if (status == DONE) qp.found[4] = 1.0;
    *closed = rounds > 0 && !undone && qp.found[3] == 0.0;
    return status;
}

/* The velocity commanded by the last level. */
static const double *commanded(const wbc_plan *plan, const wbc_qp *first) {
    wbc_qp last;
    lay_out_level(plan, (int64_t)first->found[4] - 1, &last);
    return last.x;
}

/* Reuse the factors of the first level's last solution, or factorize it. */
static int factorize_first_level(const wbc_plan *plan, const wbc_qp *first) {
    if (plan->levels == 1 && !plan->always && is_reduced(first, plan->order)) return DONE;
    return factorize(first, plan->scratch, plan->order);
}

static int solve_all_again(const wbc_plan *plan, const double *q, const double *v, const wbc_qp *first) {
    const solve_options options = solver_options(plan, 0, first);
    if (solve_again(first, &options, plan->scratch, plan->order) != DONE) return UNSOLVED;
    first->found[4] = 1.0;
    return plan->levels > 1 ? solve_below(plan, q, v) : DONE;
}

/* Size of the first level's solution, which is contiguous. */
static int64_t answer_size(const wbc_qp *first) { return first->found + 5 - first->x; }

void close_loops(const wbc_plan *plan, const double *q, const double *v) {
    wbc_qp first;
    lay_out(plan, &first);
    double *gaps = plan->scratch + plan->solver_end, *ends = gaps + plan->held;
    double *answer = ends + first.k;
    for (int round = 0; round < CLOSING_ROUNDS; round++) {
        if (!is_open(plan, q, commanded(plan, &first), gaps)) return;
        if (factorize_first_level(plan, &first) != DONE) return;
        memcpy(ends, first.b, first.k * sizeof *ends);
        memcpy(answer, first.x, answer_size(&first) * sizeof *answer);
        shift_right_hand_sides(plan, &first, gaps, 1.0);
        if (solve_all_again(plan, q, v, &first) == DONE) continue;
        memcpy(first.b, ends, first.k * sizeof *ends);
        memcpy(first.x, answer, answer_size(&first) * sizeof *answer);
        if (plan->levels > 1) solve_below(plan, q, v);
        return;
    }
}
