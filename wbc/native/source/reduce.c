/* The equalities of a QP eliminated.
 *
 * Gauss-Jordan elimination with pivots by column turns A x = b into x_d = G x_i + h. What is left,
 *
 *     minimise 1/2 x_i' H x_i + g' x_i    subject to the bounds of x_i, those of x_d as rows of G,
 *                                         and C x = (C_i + C_d G) x_i + C_d h
 *
 * has no equalities and a third fewer unknowns. Multipliers of A follow from the gradient.
 */
#include "reduce.h"
#include "linear.h"

#include <math.h>
#include <string.h>

static const double DEPENDENT = 1e-9; /* a pivot below this, in metres or radians */
static const double CONTRADICTED = 1e-5; /* by what such a row misses: no x of less than 1e4 meets it */
static const double NO_BOUND = 1e30;  /* DAQP's infinity */
/* As in wbc/qp/elimination.py. */
static const double PREFERENCE = 10.0;
/* So is what a row had in the last tick, where others solve the reduced QP: they start from there. */
static const double USUAL = 4.0;

static double clamp(double value) {
    return value > NO_BOUND ? NO_BOUND : value < -NO_BOUND ? -NO_BOUND : value;
}

static int is_free(const wbc_qp *qp, int64_t i) {
    return qp->upper[i] == INFINITY && qp->lower[i] == -INFINITY;
}

void place(const wbc_qp *qp, double *scratch, int64_t *order, reduced *r) {
    const int64_t n = qp->n, k = qp->k, left = n - k, most = left + qp->m + k;
    r->left = left, r->stride = PADDED(left), r->order = order, r->sense = (int *)(order + n);
    r->W = scratch;
    r->inverse = r->W + k * PADDED(n + 1);
    r->h = r->inverse + k * k;
    r->G = r->h + k;
    r->half = r->G + k * r->stride;
    r->H = r->half + k * r->stride;
    r->f = r->H + left * left;
    r->low = r->f + left;
    r->up = r->low + most;
    r->rows = r->up + most;
    r->multipliers = r->rows + (qp->m + k) * left;
    r->answer = r->multipliers + most;
    r->factor = r->answer + left;
    r->gradient = r->factor + k;
    r->triangle = r->gradient + n;
    r->end = r->triangle + left * PADDED(left + 1);
}

/* Columns of A that are not zero, into touched; returns how many. Arms, say, are not in the rows of
 * feet: what is zero stays so, and need not be worked on. sum (n) to work in. */
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

/* W = [A b] of the touched columns reduced until the columns place[0..k) would be those of the
 * identity: in their place stands the inverse of what they were. 0, or NO_ANSWER if dependent rows
 * leave next to nothing of one, NO_POINT if it contradicts them. liking: the factors by which pivots
 * are preferred. usual, or 0: of each row the column that it had, plus one. */
WIDE static int64_t eliminate(int64_t k, int64_t count, const int64_t *touched,
                              const double *liking, double *W, int64_t *place, int64_t *usual) {
    const int64_t width = PADDED(count + 1);
    for (int64_t c = 0; c < count; c++) place[c] = c;
    for (int64_t r = 0; r < k; r++) {
        double *restrict top = W + r * width, most = -1.0;
        int64_t chosen = r;
        for (int64_t c = r; c < count; c++) {
            double size = fabs(top[place[c]]) * liking[place[c]];
            if (usual && usual[r] == touched[place[c]] + 1) size *= USUAL;
            if (size > most) most = size, chosen = c;
        }
        if (r >= count || !(fabs(top[place[chosen]]) > DEPENDENT))
            return fabs(top[count]) > CONTRADICTED ? NO_POINT : NO_ANSWER;
        const int64_t pivot = place[chosen];
        place[chosen] = place[r], place[r] = pivot;
        if (usual) usual[r] = touched[pivot] + 1;
        const double scale = 1.0 / top[pivot];
        top[pivot] = 1.0;
        for (int64_t c = 0; c < width; c++) top[c] *= scale;
        for (int64_t i = 0; i < k; i++) {
            double *restrict to = W + i * width;
            const double factor = to[pivot];
            if (i == r || factor == 0.0) continue;
            to[pivot] = 0.0;
            for (int64_t c = 0; c < width; c++) to[c] -= factor * top[c];
        }
    }
    return 0;
}

/* order, G, h and the inverse of A_d. Returns as eliminate does. */
WIDE static int64_t solve_equalities(const wbc_qp *qp, reduced *of, int64_t *usual) {
    const int64_t n = qp->n, k = qp->k;
    double *W = of->W, *liking = of->gradient;
    int64_t *order = of->order, *touched = order + n; /* where senses are written later */
    const int64_t count = touched_columns(qp, liking, touched), width = PADDED(count + 1);
    for (int64_t c = 0; c < count; c++) liking[c] = is_free(qp, touched[c]) ? PREFERENCE : 1.0;
    for (int64_t r = 0; r < k; r++) {
        double *row = W + r * width;
        for (int64_t c = 0; c < count; c++) row[c] = qp->A[r * n + touched[c]];
        row[count] = qp->b[r];
        for (int64_t c = count + 1; c < width; c++) row[c] = 0.0;
    }
    const int64_t said = eliminate(k, count, touched, liking, W, order, usual);
    if (said < 0) return said;
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
        if (next < count && touched[next] == c)
            next++;
        else
            order[last++] = c;
    return 0;
}

/* H = P_ii + G' half + half' G with half = P_di + 1/2 P_dd G; f = g_i + P_id h + G' (..) */
WIDE static void reduce_cost(const wbc_qp *qp, const reduced *r) {
    const int64_t n = qp->n, k = qp->k, left = r->left, coupled = r->coupled, stride = r->stride;
    const int64_t *dependent = r->order, *free = r->order + k;
    const double *P = qp->P, *h = r->h;
    double *restrict factor = r->factor, *restrict pull = r->multipliers;
    for (int64_t d = 0; d < k; d++) {
        const double *row = P + dependent[d] * n;
        double *restrict to = r->half + d * stride;
        double sum = qp->g[dependent[d]];
        for (int64_t j = 0; j < left; j++) to[j] = row[free[j]];
        for (int64_t j = left; j < stride; j++) to[j] = 0.0;
        for (int64_t s = 0; s < k; s++) {
            const double entry = row[dependent[s]];
            sum += entry * h[s];
            factor[s] = 0.5 * entry;
        }
        pull[d] = sum;
        add_rows(PADDED(coupled), k, factor, r->G, stride, to);
    }
    for (int64_t i = 0; i < left; i++) {
        const double *row = P + free[i] * n;
        double sum = qp->g[free[i]], *restrict to = r->H + i * left, *restrict more = r->triangle;
        for (int64_t d = 0; d < k; d++) sum += row[dependent[d]] * h[d];
        for (int64_t j = i; j < left; j++) to[j] = row[free[j]];
        for (int64_t d = 0; d < k && i < coupled; d++) {
            factor[d] = r->G[d * stride + i];
            sum += factor[d] * pull[d];
        }
        r->f[i] = sum;
        if (i >= coupled) continue;
        const int64_t begin = i & ~(int64_t)3;
        for (int64_t j = begin; j < stride; j++) more[j] = 0.0;
        add_rows(stride - begin, k, factor, r->half + begin, stride, more + begin);
        for (int64_t d = 0; d < k; d++) factor[d] = r->half[d * stride + i];
        add_rows(PADDED(coupled) - begin, k, factor, r->G + begin, stride, more + begin);
        for (int64_t j = i; j < left; j++) to[j] += more[j];
    }
    for (int64_t i = 0; i < left; i++)
        for (int64_t j = 0; j < i; j++) r->H[i * left + j] = r->H[j * left + i];
}

/* Bounds of x_i, then C, then the bounds of x_d, where there are some; returns how many. */
WIDE static int64_t reduce_bounds(const wbc_qp *qp, const reduced *r) {
    const int64_t n = qp->n, k = qp->k, left = r->left;
    const int64_t *dependent = r->order, *free = r->order + k;
    int64_t bounded = left;
    for (int64_t i = 0; i < left; i++)
        r->up[i] = clamp(qp->upper[free[i]]), r->low[i] = clamp(qp->lower[free[i]]);
    for (int64_t m = 0; m < qp->m; m++, bounded++) {
        const double *row = qp->C + m * n;
        double *restrict to = r->rows + m * left, known = 0.0;
        for (int64_t j = 0; j < left; j++) to[j] = row[free[j]];
        for (int64_t d = 0; d < k; d++) {
            r->factor[d] = row[dependent[d]];
            known += r->factor[d] * r->h[d];
        }
        add_rows(r->coupled, k, r->factor, r->G, r->stride, to);
        r->up[bounded] = clamp(qp->u[m] - known), r->low[bounded] = clamp(qp->l[m] - known);
    }
    for (int64_t s = 0; s < k; s++) {
        const int64_t d = dependent[s];
        if (is_free(qp, d)) continue;
        r->up[bounded] = clamp(qp->upper[d] - r->h[s]);
        r->low[bounded] = clamp(qp->lower[d] - r->h[s]);
        memcpy(r->rows + (bounded++ - left) * left, r->G + s * r->stride, left * sizeof *r->rows);
    }
    return bounded;
}

WIDE void lift(const wbc_qp *qp, const reduced *r) {
    const int64_t n = qp->n, k = qp->k, left = r->left;
    const int64_t *dependent = r->order, *free = r->order + k;
    double *x = qp->x, *y = qp->y, *z = qp->z_box;
    int64_t bounded = left + qp->m;
    for (int64_t i = 0; i < left; i++) x[free[i]] = r->answer[i], z[free[i]] = r->multipliers[i];
    memcpy(qp->z, r->multipliers + left, qp->m * sizeof *qp->z);
    for (int64_t s = 0; s < k; s++) {
        const int64_t d = dependent[s];
        x[d] = r->h[s] + dot(left, r->G + s * r->stride, r->answer);
        z[d] = is_free(qp, d) ? 0.0 : r->multipliers[bounded++];
        y[s] = 0.0;
    }
    double *restrict gradient = r->gradient; /* P x + g + z + C'z = -A'y: y by the rows of x_d */
    for (int64_t i = 0; i < n; i++) gradient[i] = qp->g[i] + z[i];
    add_rows(n, n, x, qp->P, n, gradient); /* P is symmetric */
    for (int64_t m = 0; m < qp->m; m++)
        for (int64_t i = 0; i < n && qp->z[m] != 0.0; i++) gradient[i] += qp->C[m * n + i] * qp->z[m];
    for (int64_t s = 0; s < k; s++)
        for (int64_t t = 0; t < k; t++)
            y[t] -= r->inverse[s * k + t] * gradient[dependent[s]];
}

int64_t bounds_left(const wbc_qp *qp, const reduced *r) {
    int64_t bounded = r->left + qp->m;
    for (int64_t s = 0; s < qp->k; s++) bounded += !is_free(qp, r->order[s]);
    return bounded;
}

int64_t reduce(const wbc_qp *qp, reduced *r, int64_t *usual) {
    const int64_t said = r->left < 1 ? NO_ANSWER : solve_equalities(qp, r, usual);
    if (said < 0) return said;
    reduce_cost(qp, r);
    return reduce_bounds(qp, r);
}
