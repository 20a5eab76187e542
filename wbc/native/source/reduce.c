/* Elimination of the equalities of a QP.
 *
 * Gauss-Jordan elimination with pivots by column turns A x = b into x_d = G x_i + h. The reduced QP,
 *
 *     minimise 1/2 x_i' H x_i + g' x_i    subject to the bounds of x_i, those of x_d as rows of G,
 *                                         and C x = (C_i + C_d G) x_i + C_d h
 *
 * has no equalities and a third fewer unknowns. Multipliers of A follow from the gradient.
 */
#include "reduce.h"
#include "active_set.h"
#include "linear.h"
#include "problem.h"

#include <math.h>
#include <string.h>

static const double DEPENDENT = 1e-9;    /* smaller pivots [m or rad]: the row depends on those above */
static const double CONTRADICTED = 1e-6; /* residual of a dependent row, from which on it contradicts the others */
/* Unknowns without bounds are preferred as dependent ones: they add no inequality row. */
static const double FREE_PREFERRED = 10.0;
/* So is the pivot of the last tick if the reduced QP goes to an external solver, which starts warm. */
static const double SAME_PIVOT = 4.0;

static int is_free(const wbc_qp *qp, int64_t i) { return qp->upper[i] == INFINITY && qp->lower[i] == -INFINITY; }

void lay_out_reduced(const wbc_qp *qp, double *scratch, int64_t *order, reduced *r) {
    const int64_t n = qp->n, k = qp->k;
    r->rank = k, r->order = order, r->touched = order + n, r->row = r->touched + n;
    r->W = scratch;
    r->inverse = r->W + k * PADDED(n + 1);
    r->h = r->inverse + k * k;
    r->gradient = r->h + k;
    r->factor = r->gradient + n;
    r->G = r->factor + k;
}

/* What depends on the number of free unknowns. */
static void lay_out_rest(const wbc_qp *qp, reduced *r) {
    const int64_t left = r->left = qp->n - r->rank, most = left + qp->m + r->rank;
    r->stride = PADDED(left);
    r->half = r->G + r->rank * r->stride;
    r->H = r->half + r->rank * r->stride;
    r->f = r->H + left * left;
    r->low = r->f + left;
    r->up = r->low + most;
    r->rows = r->up + most;
    r->multipliers = r->rows + (qp->m + r->rank) * left;
    r->answer = r->multipliers + most;
    r->triangle = r->answer + left;
    r->end = r->triangle + left * PADDED(left + 1);
}

int64_t reduced_numbers(int64_t n, int64_t k, int64_t m) {
    const int64_t most = n + m, w = PADDED(n + 1);
    return k * w + k * k + 2 * k + n + 2 * k * w + n * n + 2 * n + 3 * most + (m + k) * n + n * w;
}

int64_t reduced_integers(int64_t n, int64_t k) { return 2 * n + k + 1; }

int is_reduced(const wbc_qp *qp, const int64_t *order) { return order[2 * qp->n + qp->k] >= 0; }

void restore_reduced(const wbc_qp *qp, double *scratch, int64_t *order, reduced *r) {
    lay_out_reduced(qp, scratch, order, r);
    r->rank = order[2 * qp->n + qp->k];
    lay_out_rest(qp, r);
    r->coupled = r->left; /* an upper bound */
}

/* Write the columns of A that are not zero to touched, and return how many. Rows of feet have none of the arms',
 * say: zeros stay zero and cost nothing. sum: scratch (n). */
INLINE int64_t touched_columns(const wbc_qp *qp, double *restrict sum, int64_t *touched) {
    const int64_t n = qp->n;
    int64_t count = 0;
    memset(sum, 0, n * sizeof *sum);
    for (int64_t r = 0; r < qp->k; r++)
        for (int64_t c = 0; c < n; c++) sum[c] += fabs(qp->A[r * n + c]);
    for (int64_t c = 0; c < n; c++)
        if (sum[c] != 0.0) touched[count++] = c;
    return count;
}

/* Return the weighted size of the best pivot of row i of W among the columns left, and write that column. */
INLINE double best_pivot(const reduced *of, int64_t i, int64_t r, int64_t count, const int64_t *place,
                         const int64_t *last_pivots, int64_t *chosen) {
    const double *row = of->W + i * PADDED(count + 1), *preference = of->gradient;
    double most = -1.0;
    for (int64_t c = r; c < count; c++) {
        double size = fabs(row[place[c]]) * preference[place[c]];
        if (last_pivots && last_pivots[of->row[i]] == of->touched[place[c]] + 1) size *= SAME_PIVOT;
        if (size > most) most = size, *chosen = c;
    }
    return most;
}

static void swap_rows(reduced *of, int64_t i, int64_t j, int64_t width) {
    double *one = of->W + i * width, *other = of->W + j * width;
    const int64_t number = of->row[i];
    of->row[i] = of->row[j], of->row[j] = number;
    for (int64_t c = 0; c < width && i != j; c++) {
        const double entry = one[c];
        one[c] = other[c], other[c] = entry;
    }
}

/* Row r depends on those above, and its b contradicts theirs: write the combination of rows of A that is 0, with b
 * below 0, to y. */
static void write_certificate(const wbc_qp *qp, const reduced *of, int64_t r, int64_t count, const int64_t *place) {
    const double *row = of->W + r * PADDED(count + 1);
    const double sign = row[count] > 0.0 ? -1.0 : 1.0;
    memset(qp->y, 0, qp->k * sizeof *qp->y);
    for (int64_t s = 0; s < r; s++) qp->y[of->row[s]] = sign * row[place[s]];
    qp->y[of->row[r]] = sign;
}

/* Reduce W = [A b] (touched columns only) until the columns place[0..rank) were those of the identity; they hold
 * the inverse of the pivots' columns instead. Dependent rows are left out; NO_POINT if one contradicts the others.
 * last_pivots and pivoted: as in reduce. */
WIDE static int64_t eliminate(const wbc_qp *qp, reduced *of, int64_t count, int64_t *last_pivots, int pivoted) {
    const int64_t width = PADDED(count + 1);
    int64_t *place = of->order;
    double *W = of->W;
    for (int64_t c = 0; c < count; c++) place[c] = c;
    for (int64_t r = 0; r < of->rank;) {
        int64_t chosen = r, best = r, column = r;
        double most = best_pivot(of, r, r, count, place, last_pivots, &chosen);
        for (int64_t i = r + 1; pivoted && i < of->rank; i++) {
            const double size = best_pivot(of, i, r, count, place, last_pivots, &column);
            if (size > most) most = size, best = i, chosen = column;
        }
        swap_rows(of, r, best, width);
        double *restrict top = W + r * width;
        if (r >= count || !(fabs(top[place[chosen]]) > DEPENDENT)) {
            if (fabs(top[count]) > CONTRADICTED) {
                write_certificate(qp, of, r, count, place);
                return NO_POINT;
            }
            swap_rows(of, r, --of->rank, width);
            continue;
        }
        const int64_t pivot = place[chosen];
        place[chosen] = place[r], place[r] = pivot;
        if (last_pivots) last_pivots[of->row[r]] = of->touched[pivot] + 1;
        const double scale = 1.0 / top[pivot];
        for (int64_t c = 0; c < width; c++) top[c] *= scale;
        top[pivot] = scale;
        int64_t begin = 0, end = count; /* rows of loops have few columns */
        while (top[begin] == 0.0) begin++;
        while (top[end - 1] == 0.0) end--;
        begin &= ~(int64_t)3, end = PADDED(end);
        for (int64_t i = 0; i < of->rank; i++) {
            double *restrict to = W + i * width;
            const double factor = to[pivot];
            if (i == r || factor == 0.0) continue;
            for (int64_t c = begin; c < end; c += 4) *(four *)(to + c) -= factor * FOUR(top + c);
            if (end <= count) to[count] -= factor * top[count];
            to[pivot] = -factor * scale; /* written last: the vector loop would wait for it */
        }
        r++;
    }
    return 0;
}

/* The part that needs A and b only: order, G, h and A_d^-1. Returns 0, or NO_POINT. */
WIDE static int64_t solve_equalities(const wbc_qp *qp, reduced *of, int64_t *last_pivots, int pivoted) {
    const int64_t n = qp->n;
    double *W = of->W, *preference = of->gradient;
    int64_t *order = of->order, *touched = of->touched;
    const int64_t count = touched_columns(qp, preference, touched), width = PADDED(count + 1);
    for (int64_t c = 0; c < count; c++) preference[c] = is_free(qp, touched[c]) ? FREE_PREFERRED : 1.0;
    for (int64_t r = 0; r < qp->k; r++) {
        double *row = W + r * width;
        for (int64_t c = 0; c < count; c++) row[c] = qp->A[r * n + touched[c]];
        row[count] = qp->b[r];
        for (int64_t c = count + 1; c < width; c++) row[c] = 0.0;
        of->row[r] = r;
    }
    const int64_t status = eliminate(qp, of, count, last_pivots, pivoted), k = of->rank;
    if (status < 0) return status;
    lay_out_rest(qp, of);
    of->coupled = count - k;
    for (int64_t d = 0; d < k; d++) {
        const double *row = W + d * width;
        double *to = of->G + d * of->stride;
        for (int64_t j = 0; j < of->coupled; j++) to[j] = -row[order[k + j]];
        for (int64_t j = of->coupled; j < of->stride; j++) to[j] = 0.0;
        for (int64_t s = 0; s < k; s++) of->inverse[d * k + s] = row[order[s]];
        of->h[d] = row[count];
    }
    for (int64_t c = 0; c < count; c++) order[c] = touched[order[c]];
    for (int64_t c = 0, next = 0, last = count; c < n; c++)
        if (next < count && touched[next] == c) next++;
        else order[last++] = c;
    return 0;
}

/* f = g_i + P_id h + G' (g_d + P_dd h) */
INLINE void reduce_gradient(const wbc_qp *qp, const reduced *r) {
    const int64_t n = qp->n, k = r->rank, left = r->left;
    const int64_t *dependent = r->order, *free = r->order + k;
    double *gradient = r->gradient, *factor = r->factor;
    memcpy(gradient, qp->g, n * sizeof *gradient);
    add_numbered(n, k, r->h, dependent, qp->P, 0, gradient); /* P is symmetric */
    for (int64_t d = 0; d < k; d++) factor[d] = gradient[dependent[d]];
    for (int64_t i = 0; i < left; i++) r->f[i] = gradient[free[i]];
    add_rows(r->coupled, k, factor, r->G, r->stride, r->f);
}

/* H = P_ii + G' half + half' G with half = P_di + 1/2 P_dd G */
WIDE static void reduce_cost(const wbc_qp *qp, const reduced *r) {
    const int64_t n = qp->n, k = r->rank, left = r->left, coupled = r->coupled, stride = r->stride;
    const int64_t *dependent = r->order, *free = r->order + k;
    const double *P = qp->P;
    double *restrict factor = r->factor;
    reduce_gradient(qp, r);
    for (int64_t d = 0; d < k; d++) {
        const double *row = P + dependent[d] * n;
        double *restrict to = r->half + d * stride;
        for (int64_t j = 0; j < left; j++) to[j] = row[free[j]];
        for (int64_t j = left; j < stride; j++) to[j] = 0.0;
        for (int64_t s = 0; s < k; s++) factor[s] = 0.5 * row[dependent[s]];
        add_rows(PADDED(coupled), k, factor, r->G, stride, to);
    }
    for (int64_t i = 0; i < left; i++) {
        const double *row = P + free[i] * n;
        double *restrict to = r->H + i * left, *restrict more = r->triangle;
        for (int64_t j = i; j < left; j++) to[j] = row[free[j]];
        if (i >= coupled) continue;
        const int64_t begin = i & ~(int64_t)3;
        for (int64_t j = begin; j < stride; j++) more[j] = 0.0;
        for (int64_t d = 0; d < k; d++) factor[d] = r->G[d * stride + i];
        add_rows(stride - begin, k, factor, r->half + begin, stride, more + begin);
        for (int64_t d = 0; d < k; d++) factor[d] = r->half[d * stride + i];
        add_rows(PADDED(coupled) - begin, k, factor, r->G + begin, stride, more + begin);
        for (int64_t j = i; j < left; j++) to[j] += more[j];
    }
    for (int64_t i = 0; i < left; i++)
        for (int64_t j = 0; j < i; j++) r->H[i * left + j] = r->H[j * left + i];
}

/* Bounds of x_i, then C, then finite bounds of x_d; returns how many. again: update the bounds, keep the rows. */
INLINE int64_t reduce_bounds(const wbc_qp *qp, const reduced *r, int again) {
    const int64_t n = qp->n, k = r->rank, left = r->left;
    const int64_t *dependent = r->order, *free = r->order + k;
    int64_t bounded = left;
    for (int64_t i = 0; i < left; i++) r->up[i] = qp->upper[free[i]], r->low[i] = qp->lower[free[i]];
    for (int64_t m = 0; m < qp->m; m++, bounded++) {
        const double *row = qp->C + m * n;
        double *restrict to = r->rows + m * left, known = 0.0;
        for (int64_t d = 0; d < k; d++) {
            r->factor[d] = row[dependent[d]];
            known += r->factor[d] * r->h[d];
        }
        if (!again) {
            for (int64_t j = 0; j < left; j++) to[j] = row[free[j]];
            add_rows(r->coupled, k, r->factor, r->G, r->stride, to);
        }
        r->up[bounded] = qp->u[m] - known, r->low[bounded] = qp->l[m] - known;
    }
    for (int64_t s = 0; s < k; s++) {
        const int64_t d = dependent[s];
        if (is_free(qp, d)) continue;
        r->up[bounded] = qp->upper[d] - r->h[s];
        r->low[bounded] = qp->lower[d] - r->h[s];
        if (!again) memcpy(r->rows + (bounded - left) * left, r->G + s * r->stride, left * sizeof *r->rows);
        bounded++;
    }
    return bounded;
}

/* Write y, z, z_box; r->gradient is P x + g, to which z_box + C'z is added: its rows of x_d are -A'y. */
WIDE static void lift_multipliers(const wbc_qp *qp, const reduced *r) {
    const int64_t n = qp->n, k = r->rank, left = r->left;
    const int64_t *dependent = r->order, *free = r->order + k;
    double *y = qp->y, *z = qp->z_box, *restrict gradient = r->gradient;
    double *factor = r->factor, *pull = r->W; /* which is no longer needed */
    int64_t bounded = left + qp->m;
    for (int64_t i = 0; i < left; i++) z[free[i]] = r->multipliers[i];
    for (int64_t s = 0; s < k; s++) z[dependent[s]] = is_free(qp, dependent[s]) ? 0.0 : r->multipliers[bounded++];
    memcpy(qp->z, r->multipliers + left, qp->m * sizeof *qp->z);
    for (int64_t i = 0; i < n; i++) gradient[i] += z[i];
    add_rows(n, qp->m, qp->z, qp->C, n, gradient);
    for (int64_t s = 0; s < k; s++) factor[s] = -gradient[dependent[s]];
    memset(pull, 0, k * sizeof *pull);
    add_rows(k, k, factor, r->inverse, k, pull);
    memset(y, 0, qp->k * sizeof *y);
    for (int64_t t = 0; t < k; t++) y[r->row[t]] = pull[t];
}

WIDE void lift_point(const wbc_qp *qp, const reduced *r) {
    const int64_t k = r->rank, left = r->left, *dependent = r->order, *free = r->order + k;
    for (int64_t i = 0; i < left; i++) qp->x[free[i]] = r->answer[i];
    for (int64_t s = 0; s < k; s++) qp->x[dependent[s]] = r->h[s] + dot(r->coupled, r->G + s * r->stride, r->answer);
}

WIDE void lift(const wbc_qp *qp, const reduced *r) {
    const int64_t n = qp->n;
    double *restrict gradient = r->gradient;
    lift_point(qp, r);
    memcpy(gradient, qp->g, n * sizeof *gradient);
    add_slope(qp, qp->x, gradient);
    lift_multipliers(qp, r);
}

void lift_certificate(const wbc_qp *qp, const reduced *r) {
    memset(r->gradient, 0, qp->n * sizeof *r->gradient);
    lift_multipliers(qp, r);
}

int64_t bounds_left(const wbc_qp *qp, const reduced *r) {
    int64_t bounded = r->left + qp->m;
    for (int64_t s = 0; s < r->rank; s++) bounded += !is_free(qp, r->order[s]);
    return bounded;
}

WIDE int64_t reduce(const wbc_qp *qp, reduced *r, int64_t *last_pivots, int pivoted) {
    r->row[qp->k] = -1;
    const int64_t status = solve_equalities(qp, r, last_pivots, pivoted);
    if (status < 0) return status;
    r->row[qp->k] = r->rank; /* for restore_reduced */
    reduce_cost(qp, r);
    return reduce_bounds(qp, r, 0);
}

WIDE void update_right_hand_side(const wbc_qp *qp, reduced *r) {
    const int64_t n = qp->n, k = r->rank, *dependent = r->order;
    double *factor = r->factor;
    for (int64_t t = 0; t < k; t++) factor[t] = qp->b[r->row[t]];
    for (int64_t s = 0; s < k; s++) r->h[s] = dot(k, r->inverse + s * k, factor);
    for (int64_t t = k; t < qp->k; t++) {
        double end = 0.0;
        for (int64_t d = 0; d < k; d++) end += qp->A[r->row[t] * n + dependent[d]] * r->h[d];
        qp->b[r->row[t]] = end;
    }
    reduce_gradient(qp, r);
    reduce_bounds(qp, r, 1);
}
