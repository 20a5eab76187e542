/* A QP solved: what loops determine taken out (fold.c), its equalities eliminated (reduce.c), what is left by the active-set method unless the
 * optimum of the cost alone keeps all bounds, and the answer judged by the KKT residuals of the full QP.
 */
#include "solve.h"
#include "active_set.h"
#include "fold.h"
#include "linear.h"
#include "problem.h"
#include "reduce.h"

#include <string.h>

/* Whether the optimum of the cost alone keeps all bounds and rows: then it is the optimum. again: its
 * factors are there already. */
WIDE static int is_kept(const wbc_qp *qp, const reduced *r, int64_t bounded, int again) {
    if (again)
        least_again(r->left, r->f, r->triangle, r->answer);
    else if (!least(r->left, r->H, r->left, r->f, r->triangle, r->answer))
        return 0;
    for (int64_t i = 0; i < bounded; i++) {
        const int64_t row = i - r->left, entries = row < qp->m ? r->left : r->coupled;
        const double value =
            row < 0 ? r->answer[i] : dot(entries, r->rows + row * r->left, r->answer);
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
static int fail(const wbc_qp *qp, const folded *f, const reduced *r, int64_t said, int left) {
    const wbc_qp *rest = &f->rest;
    qp->found[3] = (double)said;
    if (said != NO_POINT) return UNSOLVED;
    if (left) /* of what is left without equalities */
        lift_certificate(rest, r);
    else { /* of the equalities alone, which wrote y */
        memset(rest->z, 0, rest->m * sizeof *rest->z);
        memset(rest->z_box, 0, rest->n * sizeof *rest->z_box);
    }
    if (f->count > 0) {
        memset(f->gradient, 0, qp->n * sizeof *f->gradient);
        unfold(qp, f);
    }
    return INFEASIBLE;
}

/* By how much an answer may pass a bound, however large the numbers of the rows are: commands may not. */
static const double PASSED = 1e-7;

/* x, y, z, z of the box, the three residuals and the number of iterations of a QP. accuracy: by how much
 * of eps they may be more. */
static int conclude(const wbc_qp *qp, const folded *f, const reduced *r, const double *give,
                    double accuracy, int64_t iterations) {
    if (f->count > 0) {
        lift_point(&f->rest, r);
        unfold_point(qp, f, r->gradient);
        lift_multipliers(&f->rest, r);
        unfold(qp, f);
    } else
        lift(qp, r);
    residuals(qp, give, f->count > 0 ? f->gradient : r->gradient);
    qp->found[3] = (double)iterations;
    for (int i = 0; i < 3; i++)
        if (!(qp->found[i] <= accuracy * qp->eps)) return UNSOLVED; /* NaN is not */
    for (int64_t i = 0; i < qp->n && accuracy > 1.0; i++)
        if (qp->x[i] < qp->lower[i] - PASSED || qp->x[i] > qp->upper[i] + PASSED) return UNSOLVED;
    return DONE;
}

int wbc_sizes(int64_t n, int64_t k, int64_t m, int64_t loops, int64_t *sizes) {
    sizes[0] = reduced_numbers(n, k, m) + n + m + active_set_numbers(n, n + m);
    sizes[2] = reduced_integers(n, k);
    if (loops > 0) sizes[0] += folded_numbers(n, k, m), sizes[2] += folded_integers(n, k);
    sizes[1] = sizes[2] + 3 * (n + m);
    return DONE;
}

/* The optimum of the cost alone, which keeps all bounds and rows, while ends are corrected by it. */
static void correct(const wbc_qp *qp, reduced *r, int64_t bounded, const solving *how) {
    for (;;) {
        lift_point(qp, r);
        if (!how->correct(how->at, qp, how->change, 0)) return;
        renew(qp, r);
        if (is_kept(qp, r, bounded, 1)) continue;
        how->correct(how->at, qp, how->change, 1); /* back to where it kept them */
        renew(qp, r);
        is_kept(qp, r, bounded, 1);
        return;
    }
}

int solve(const wbc_qp *qp, const solving *how, double *scratch, int64_t *order) {
    folded f;
    reduced r;
    fold(qp, how->loops, how->usual, scratch, order, &f);
    place(&f.rest, f.scratch, f.order, &r);
    int64_t *usual = how->usual && f.count > 0 ? how->usual + f.loops : how->usual;
    const int64_t bounded = reduce(&f.rest, &r, usual, how->pivoted);
    if (bounded < 0) return fail(qp, &f, &r, bounded, 0);
    if (!how->always && is_kept(&f.rest, &r, bounded, 0)) {
        if (how->correct) correct(qp, &r, bounded, how);
        if (conclude(qp, &f, &r, how->give, how->accuracy, 0) == DONE) return DONE;
    }
    qp->found[0] = (double)(bounded - r.left);
    return how->outside ? REDUCED : solve_reduced(qp, how, scratch, order, 0, 0, 1.0, 0);
}

int solve_reduced(const wbc_qp *qp, const solving *how, double *scratch, int64_t *order,
                  const double *x, const double *z, double scale, int64_t iterations) {
    folded f;
    reduced r;
    find_folded(qp, how->loops, scratch, order, &f);
    resume(&f.rest, f.scratch, f.order, &r);
    const int64_t bounded = bounds_left(&f.rest, &r), rows = bounded - r.left;
    if (x) {
        memcpy(r.answer, x, r.left * sizeof *x);
        for (int64_t i = 0; i < r.left; i++) r.multipliers[i] = z[rows + i] / scale;
        for (int64_t i = 0; i < rows; i++) r.multipliers[r.left + i] = z[i] / scale;
    } else {
        iterations = ask(&r, bounded, how->give, qp->m, how->most, how->work);
        if (iterations < 0) return fail(qp, &f, &r, iterations, 1);
    }
    return conclude(qp, &f, &r, how->give, how->accuracy, iterations);
}

int prepare(const wbc_qp *qp, double *scratch, int64_t *order) {
    reduced r;
    place(qp, scratch, order, &r);
    if (reduce(qp, &r, 0, 0) < 0) return UNSOLVED;
    return least(r.left, r.H, r.left, r.f, r.triangle, r.answer) ? DONE : UNSOLVED;
}

int solve_again(const wbc_qp *qp, const solving *how, double *scratch, int64_t *order) {
    folded f;
    reduced r;
    find_folded(qp, 0, scratch, order, &f);
    resume(qp, scratch, order, &r);
    renew(qp, &r);
    const int64_t bounded = bounds_left(qp, &r);
    if (is_kept(qp, &r, bounded, 1)) return conclude(qp, &f, &r, how->give, how->accuracy, 0);
    const int64_t iterations = ask(&r, bounded, how->give, qp->m, how->most, how->work);
    if (iterations < 0) return fail(qp, &f, &r, iterations, 1);
    return conclude(qp, &f, &r, how->give, how->accuracy, iterations);
}

int wbc_solve_flat(int64_t n, int64_t k, int64_t m, double *numbers, double eps, int64_t most, double *out,
                   int64_t *order) {
    wbc_qp qp = {.n = n, .k = k, .m = m, .wide = n, .eps = eps, .P = numbers, .x = out};
    qp.A = qp.P + n * n, qp.C = qp.A + k * n, qp.g = qp.C + m * n, qp.lower = qp.g + n;
    qp.upper = qp.lower + n, qp.b = qp.upper + n, qp.l = qp.b + k, qp.u = qp.l + m;
    qp.y = qp.x + n, qp.z = qp.y + k, qp.z_box = qp.z + m, qp.found = qp.z_box + n;
    return wbc_solve_qp(&qp, 0, most, qp.found + 4, order);
}

int wbc_solve_qp(const wbc_qp *qp, const double *give, int64_t most, double *scratch,
                 int64_t *order) {
    const int64_t integers = reduced_integers(qp->n, qp->k);
    const solving how = {give, 0, 0, order + integers, most, 1.0, 1, 0, 0, 0, 0, 0};
    return is_qp(qp) ? solve(qp, &how, scratch, order) : NOT_FINITE;
}
