/* Solve a QP: eliminate its equalities (reduce.c), take the unconstrained optimum if it
 * is feasible, else run the active-set method; check the KKT residuals of the full QP. */
#include "solve.h"
#include "active_set.h"
#include "linear.h"
#include "problem.h"
#include "reduce.h"

#include <string.h>

/* Whether the unconstrained optimum of the reduced QP is feasible, and so the solution. again: reuse the factors. */
WIDE static int is_unconstrained_optimum_feasible(const wbc_qp *qp, const reduced *r, int64_t bounded, int again) {
    if (again) cholesky_solve_again(r->left, r->f, r->triangle, r->answer);
    else if (!cholesky_solve(r->left, r->H, r->left, r->f, r->triangle, r->answer)) return 0;
    for (int64_t i = 0; i < bounded; i++) {
        const int64_t row = i - r->left, entries = row < qp->m ? r->left : r->coupled;
        const double value = row < 0 ? r->answer[i] : dot(entries, r->rows + row * r->left, r->answer);
        if (!(value >= r->low[i] && value <= r->up[i])) return 0;
        r->multipliers[i] = 0.0;
    }
    return 1;
}

/* Solve the reduced QP by the active-set method. Returns the number of iterations, or why there is no solution. */
static int64_t solve_bounded(const reduced *r, int64_t bounded, const double *compliance, int64_t rows, int64_t most,
                             int64_t *order) {
    double *every = r->end; /* of bounds, which are hard, then of rows */
    memset(every, 0, bounded * sizeof *every);
    if (compliance) memcpy(every + r->left, compliance, rows * sizeof *compliance);
    return active_set_solve(r->left, bounded, r->H, r->f, r->rows, r->low, r->up, every, most, every + bounded, order,
                            r->answer, r->multipliers);
}

/* Report why there is no solution; with a certificate if the QP is infeasible. */
static int fail(const wbc_qp *qp, const reduced *r, int64_t status, int left) {
    qp->found[3] = (double)status;
    if (status != NO_POINT) return UNSOLVED;
    if (left) /* the inequalities are infeasible */
        lift_certificate(qp, r);
    else { /* the equalities are: y is the certificate */ memset(qp->z, 0, qp->m * sizeof *qp->z);
        memset(qp->z_box, 0, qp->n * sizeof *qp->z_box);
    }
    return INFEASIBLE;
}

/* Largest violation of a bound in a solution, however large the numbers of the rows: a command has none. */
static const double BOUND_TOLERANCE = 1e-7;

/* Write the full solution, its residuals and the number of iterations. accuracy: as in solve_options. */
static int finish(const wbc_qp *qp, const reduced *r, const double *compliance, double accuracy, int64_t iterations) {
    lift(qp, r);
    residuals(qp, compliance, r->gradient);
    qp->found[3] = (double)iterations;
    for (int i = 0; i < 3; i++)
        if (!(qp->found[i] <= accuracy * qp->eps)) return UNSOLVED; /* NaN is not */
    for (int64_t i = 0; i < qp->n && accuracy > 1.0; i++)
        if (qp->x[i] < qp->lower[i] - BOUND_TOLERANCE || qp->x[i] > qp->upper[i] + BOUND_TOLERANCE) return UNSOLVED;
    return DONE;
}

int wbc_sizes(int64_t n, int64_t k, int64_t m, int64_t *sizes) {
    sizes[0] = reduced_numbers(n, k, m) + n + m + active_set_numbers(n, n + m);
    sizes[2] = reduced_integers(n, k);
    sizes[1] = sizes[2] + 3 * (n + m);
    return DONE;
}

/* Correct b by the unconstrained optimum as long as that stays feasible. */
static void correct_repeatedly(const wbc_qp *qp, reduced *r, int64_t bounded, const solve_options *options) {
    for (;;) {
        lift_point(qp, r);
        if (!options->correct(options->at, qp, options->change, 0)) return;
        update_right_hand_side(qp, r);
        if (is_unconstrained_optimum_feasible(qp, r, bounded, 1)) continue;
        options->correct(options->at, qp, options->change, 1); /* back to the last feasible one */
        update_right_hand_side(qp, r);
        is_unconstrained_optimum_feasible(qp, r, bounded, 1);
        return;
    }
}

int solve(const wbc_qp *qp, const solve_options *options, double *scratch, int64_t *order) {
    reduced r;
    lay_out_reduced(qp, scratch, order, &r);
    const int64_t bounded = reduce(qp, &r, options->last_pivots, options->pivoted);
    if (bounded < 0) return fail(qp, &r, bounded, 0);
    if (!options->always && is_unconstrained_optimum_feasible(qp, &r, bounded, 0)) {
        if (options->correct) correct_repeatedly(qp, &r, bounded, options);
        if (finish(qp, &r, options->compliance, options->accuracy, 0) == DONE) return DONE;
    }
    qp->found[0] = (double)(bounded - r.left);
    return options->outside ? REDUCED : solve_reduced(qp, options, scratch, order, 0, 0, 1.0, 0);
}

int solve_reduced(const wbc_qp *qp, const solve_options *options, double *scratch, int64_t *order, const double *x,
                  const double *z, double scale, int64_t iterations) {
    reduced r;
    restore_reduced(qp, scratch, order, &r);
    const int64_t bounded = bounds_left(qp, &r), rows = bounded - r.left;
    if (x) {
        memcpy(r.answer, x, r.left * sizeof *x);
        for (int64_t i = 0; i < r.left; i++) r.multipliers[i] = z[rows + i] / scale;
        for (int64_t i = 0; i < rows; i++) r.multipliers[r.left + i] = z[i] / scale;
    } else {
        iterations = solve_bounded(&r, bounded, options->compliance, qp->m, options->most, options->work);
        if (iterations < 0) return fail(qp, &r, iterations, 1);
    }
    return finish(qp, &r, options->compliance, options->accuracy, iterations);
}

int factorize(const wbc_qp *qp, double *scratch, int64_t *order) {
    reduced r;
    lay_out_reduced(qp, scratch, order, &r);
    if (reduce(qp, &r, 0, 0) < 0) return UNSOLVED;
    return cholesky_solve(r.left, r.H, r.left, r.f, r.triangle, r.answer) ? DONE : UNSOLVED;
}

int solve_again(const wbc_qp *qp, const solve_options *options, double *scratch, int64_t *order) {
    reduced r;
    restore_reduced(qp, scratch, order, &r);
    update_right_hand_side(qp, &r);
    const int64_t bounded = bounds_left(qp, &r);
    if (is_unconstrained_optimum_feasible(qp, &r, bounded, 1))
        return finish(qp, &r, options->compliance, options->accuracy, 0);
    return solve_reduced(qp, options, scratch, order, 0, 0, 1.0, 0);
}

int wbc_solve_qp(const wbc_qp *qp, const double *compliance, int64_t most, double *scratch, int64_t *order) {
    const int64_t integers = reduced_integers(qp->n, qp->k);
    const solve_options options = {
        .compliance = compliance, .work = order + integers, .most = most, .accuracy = 1.0, .pivoted = 1};
    return is_qp(qp) ? solve(qp, &options, scratch, order) : NOT_FINITE;
}
