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
    r->left = left, r->order = order, r->sense = (int *)(order + n);
    r->W = scratch;
    r->G = r->W + k * (n + 1);
    r->half = r->G + k * left;
    r->H = r->half + k * left;
    r->f = r->H + left * left;
    r->low = r->f + left;
    r->up = r->low + most;
    r->rows = r->up + most;
    r->multipliers = r->rows + (qp->m + k) * left;
    r->answer = r->multipliers + most;
    r->factor = r->answer + left;
    r->gradient = r->factor + 2 * k;
    r->triangle = r->gradient + n;
    r->end = r->triangle + left * (left + 1);
}

/* W = [A b] reduced until the columns order[0..k) would be those of the identity: in their place
 * stands the inverse of what they were. 0, or NO_ANSWER if dependent rows leave next to nothing of
 * one, NO_POINT if it contradicts them. usual, or 0: of each row the column that it had, plus one. */
WIDE static int64_t eliminate(const wbc_qp *qp, reduced *of, int64_t *usual) {
    const int64_t n = qp->n, k = qp->k, width = n + 1;
    double *restrict W = of->W;
    int64_t *order = of->order;
    for (int64_t r = 0; r < k; r++) {
        memcpy(W + r * width, qp->A + r * n, n * sizeof *W);
        W[r * width + n] = qp->b[r];
    }
    for (int64_t c = 0; c < n; c++) order[c] = c;
    for (int64_t r = 0; r < k; r++) {
        double *restrict top = W + r * width, most = -1.0;
        int64_t column = r;
        for (int64_t c = r; c < n; c++) {
            double size = fabs(top[order[c]]) * (is_free(qp, order[c]) ? PREFERENCE : 1.0);
            if (usual && usual[r] == order[c] + 1) size *= USUAL;
            if (size > most) most = size, column = c;
        }
        const int64_t pivot = order[column];
        if (!(fabs(top[pivot]) > DEPENDENT))
            return fabs(top[n]) > CONTRADICTED ? NO_POINT : NO_ANSWER;
        order[column] = order[r], order[r] = pivot;
        if (usual) usual[r] = pivot + 1;
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
    int64_t last = k; /* arms, say, are zero in the rows of feet: these columns go behind */
    for (int64_t c = k; c < n; c++) {
        const int64_t column = order[c];
        int64_t r = 0;
        while (r < k && W[r * width + column] == 0.0) r++;
        if (r < k) order[c] = order[last], order[last++] = column;
    }
    of->coupled = last - k;
    return 0;
}

/* H = P_ii + G' half + half' G with half = P_di + 1/2 P_dd G; f = g_i + P_id h + G' (..) */
WIDE static void reduce_cost(const wbc_qp *qp, const reduced *r) {
    const int64_t n = qp->n, k = qp->k, left = r->left, coupled = r->coupled, width = n + 1;
    const int64_t *dependent = r->order, *free = r->order + k;
    const double *P = qp->P, *W = r->W;
    for (int64_t d = 0; d < k; d++)
        for (int64_t j = 0; j < left; j++) r->G[d * left + j] = -W[d * width + free[j]];
    for (int64_t d = 0; d < k; d++) {
        const double *row = P + dependent[d] * n;
        double *restrict to = r->half + d * left;
        double pull = qp->g[dependent[d]];
        for (int64_t j = 0; j < left; j++) to[j] = row[free[j]];
        for (int64_t s = 0; s < k; s++) {
            pull += row[dependent[s]] * W[s * width + n];
            r->factor[s] = 0.5 * row[dependent[s]];
        }
        add_rows(coupled, k, r->factor, r->G, left, to);
        r->multipliers[d] = pull;
    }
    for (int64_t i = 0; i < left; i++) {
        const double *row = P + free[i] * n;
        double sum = qp->g[free[i]], *restrict to = r->H + i * left;
        for (int64_t d = 0; d < k; d++)
            sum += row[dependent[d]] * W[d * width + n] + r->G[d * left + i] * r->multipliers[d];
        r->f[i] = sum;
        for (int64_t j = i; j < left; j++) to[j] = row[free[j]];
        if (i >= coupled) continue;
        for (int64_t d = 0; d < k; d++) {
            r->factor[d] = r->half[d * left + i];
            r->factor[k + d] = r->G[d * left + i];
        }
        add_rows(left - i, 2 * k, r->factor, r->G + i, left, to + i); /* G, then half */
    }
    for (int64_t i = 0; i < left; i++)
        for (int64_t j = 0; j < i; j++) r->H[i * left + j] = r->H[j * left + i];
}

/* Bounds of x_i, then C, then the bounds of x_d, where there are some; returns how many. */
WIDE static int64_t reduce_bounds(const wbc_qp *qp, const reduced *r) {
    const int64_t n = qp->n, k = qp->k, left = r->left, width = n + 1;
    const int64_t *dependent = r->order, *free = r->order + k;
    const double *W = r->W;
    int64_t bounded = left;
    for (int64_t i = 0; i < left; i++)
        r->up[i] = clamp(qp->upper[free[i]]), r->low[i] = clamp(qp->lower[free[i]]);
    for (int64_t m = 0; m < qp->m; m++, bounded++) {
        const double *row = qp->C + m * n;
        double *restrict to = r->rows + m * left, known = 0.0;
        for (int64_t j = 0; j < left; j++) to[j] = row[free[j]];
        for (int64_t d = 0; d < k; d++) {
            r->factor[d] = row[dependent[d]];
            known += r->factor[d] * W[d * width + n];
        }
        add_rows(r->coupled, k, r->factor, r->G, left, to);
        r->up[bounded] = clamp(qp->u[m] - known), r->low[bounded] = clamp(qp->l[m] - known);
    }
    for (int64_t s = 0; s < k; s++) {
        const int64_t d = dependent[s];
        if (is_free(qp, d)) continue;
        r->up[bounded] = clamp(qp->upper[d] - W[s * width + n]);
        r->low[bounded] = clamp(qp->lower[d] - W[s * width + n]);
        memcpy(r->rows + (bounded++ - left) * left, r->G + s * left, left * sizeof *r->rows);
    }
    return bounded;
}

void lift(const wbc_qp *qp, const reduced *r) {
    const int64_t n = qp->n, k = qp->k, left = r->left, width = n + 1;
    const int64_t *dependent = r->order, *free = r->order + k;
    double *x = qp->x, *y = qp->y, *z = qp->z_box;
    int64_t bounded = left + qp->m;
    for (int64_t i = 0; i < left; i++) x[free[i]] = r->answer[i], z[free[i]] = r->multipliers[i];
    memcpy(qp->z, r->multipliers + left, qp->m * sizeof *qp->z);
    for (int64_t s = 0; s < k; s++) {
        const int64_t d = dependent[s];
        x[d] = r->W[s * width + n] + dot(left, r->G + s * left, r->answer);
        z[d] = is_free(qp, d) ? 0.0 : r->multipliers[bounded++];
        y[s] = 0.0;
    }
    /* A_d' y = -(P x + g + z + C'z)_d, and W holds the inverse of A_d */
    for (int64_t s = 0; s < k; s++) {
        const int64_t d = dependent[s];
        double sum = qp->g[d] + z[d] + dot(n, qp->P + d * n, x);
        for (int64_t m = 0; m < qp->m; m++)
            if (qp->z[m] != 0.0) sum += qp->C[m * n + d] * qp->z[m];
        for (int64_t t = 0; t < k; t++) y[t] -= r->W[s * width + dependent[t]] * sum;
    }
}

int64_t bounds_left(const wbc_qp *qp, const reduced *r) {
    int64_t bounded = r->left + qp->m;
    for (int64_t s = 0; s < qp->k; s++) bounded += !is_free(qp, r->order[s]);
    return bounded;
}

int64_t reduce(const wbc_qp *qp, reduced *r, int64_t *usual) {
    const int64_t said = r->left < 1 ? NO_ANSWER : eliminate(qp, r, usual);
    if (said < 0) return said;
    reduce_cost(qp, r);
    return reduce_bounds(qp, r);
}
