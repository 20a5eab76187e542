/* The QP of a plain tick solved by DAQP, its equalities eliminated first, and the answer checked.
 *
 * Gauss-Jordan elimination with pivots by column turns A x = b into x_d = G x_i + h. What is left,
 *
 *     minimise 1/2 x_i' H x_i + g' x_i    subject to the bounds of x_i, and of x_d as rows of G,
 *
 * has no equalities and a third fewer unknowns. Multipliers of A follow from the gradient, and the
 * KKT residuals are those of the full QP: what wbc/qp/kkt.py computes.
 */
#include "core.h"

#include <string.h>

/* As in DAQP's types.h and api.h; wbc/qp/daqp_direct.py knows for which versions. */
typedef struct {
    int n, m, simple;
    double *H, *f, *A, *upper, *lower;
    int *sense, *breaks;
    int hierarchy, kind;
} daqp_problem;
typedef struct {
    double *x, *multipliers, value, slack;
    int flag, iterations, nodes;
    double solve_time, setup_time, reserve[8];
} daqp_result;
typedef void daqp_quadprog(daqp_result *, daqp_problem *, void *);

static const double DEPENDENT = 1e-9; /* a pivot below this, in metres or radians */
static const double NO_BOUND = 1e30;  /* DAQP's infinity */

static double clamp(double value) {
    return value > NO_BOUND ? NO_BOUND : value < -NO_BOUND ? -NO_BOUND : value;
}

/* W = [A b 1] reduced until the columns order[0..k) are those of the identity; false if dependent
 * rows leave next to nothing of one. */
static int eliminate(int64_t k, int64_t n, double *restrict W, int64_t *order) {
    const int64_t width = n + 1 + k;
    for (int64_t c = 0; c < n; c++) order[c] = c;
    for (int64_t r = 0; r < k; r++) {
        double *restrict top = W + r * width, most = -1.0;
        int64_t column = r;
        for (int64_t c = r; c < n; c++) {
            const double size = fabs(top[order[c]]);
            if (size > most) most = size, column = c;
        }
        if (!(most > DEPENDENT)) return 0;
        const int64_t pivot = order[column];
        order[column] = order[r], order[r] = pivot;
        const double scale = 1.0 / top[pivot];
        for (int64_t c = 0; c < width; c++) top[c] *= scale;
        top[pivot] = 1.0;
        for (int64_t i = 0; i < k; i++) {
            double *restrict to = W + i * width;
            const double factor = to[pivot];
            if (i == r || factor == 0.0) continue;
            for (int64_t c = 0; c < width; c++) to[c] -= factor * top[c];
            to[pivot] = 0.0;
        }
    }
    return 1;
}

/* The larger, or what is not a number. */
static double worse(double one, double other) {
    return one != one || other <= one ? one : other;
}

/* Primal, dual and complementarity residuals of x, y, z. */
static void residuals(int64_t n, int64_t k, const double *P, const double *A, const double *g,
                      const double *lower, const double *upper, const double *b, const double *x,
                      const double *y, const double *z, double *found) {
    double primal = 0.0, dual = 0.0, clash = 0.0;
    for (int64_t i = 0; i < n; i++) {
        double sum = g[i] + z[i];
        for (int64_t j = 0; j < n; j++) sum += P[i * n + j] * x[j];
        for (int64_t r = 0; r < k; r++) sum += A[r * n + i] * y[r];
        dual = worse(dual, fabs(sum));
        const double above = upper[i] - x[i], below = x[i] - lower[i];
        primal = worse(worse(primal, -above), -below);
        const double slack = fabs(z[i] > 0.0 ? above : below), size = fabs(z[i]);
        clash = worse(clash, slack < size ? slack : size);
    }
    for (int64_t r = 0; r < k; r++) {
        double sum = -b[r];
        for (int64_t j = 0; j < n; j++) sum += A[r * n + j] * x[j];
        primal = worse(primal, fabs(sum));
    }
    found[0] = primal, found[1] = dual, found[2] = clash;
}

/* Solve the QP in out, and write x (nv), y (held), z of the box (nv), the three residuals and the
 * number of iterations behind it. */
int wbc_solve(const wbc_plan *plan) {
    const int64_t n = plan->tree->nv, k = plan->held, left = n - k, width = n + 1 + k;
    const double *P = plan->out, *A = P + n * n, *g = A + k * n, *lower = g + n;
    const double *upper = lower + n, *b = upper + n;
    double *x = plan->out + (n * n + k * n + 3 * n + k) + plan->costs + 1, *y = x + n, *z = y + k;
    double *W = plan->scratch, *G = W + k * width, *half = G + k * left, *H = half + k * left;
    double *f = H + left * left, *up = f + left, *low = up + n, *rows = low + n;
    double *multipliers = rows + k * left, *answer = multipliers + n;
    int64_t *order = plan->order, bounded = left;
    int *sense = (int *)(plan->order + n);
    daqp_quadprog *quadprog;
    memcpy(&quadprog, &plan->quadprog, sizeof quadprog); /* ISO C has no cast to a function */
    if (!quadprog || left < 1) return UNSOLVED;

    memset(W, 0, k * width * sizeof *W);
    for (int64_t r = 0; r < k; r++) {
        memcpy(W + r * width, A + r * n, n * sizeof *W);
        W[r * width + n] = b[r];
        W[r * width + n + 1 + r] = 1.0;
    }
    if (!eliminate(k, n, W, order)) return UNSOLVED;
    const int64_t *dependent = order, *free = order + k;
    for (int64_t r = 0; r < k; r++)
        for (int64_t j = 0; j < left; j++) G[r * left + j] = -W[r * width + free[j]];
    /* H = P_ii + G' half + half' G with half = P_di + 1/2 P_dd G; f = g_i + P_id h + G' (..) */
    for (int64_t r = 0; r < k; r++) {
        const double *row = P + dependent[r] * n;
        double *restrict to = half + r * left;
        double pull = g[dependent[r]];
        for (int64_t j = 0; j < left; j++) to[j] = row[free[j]];
        for (int64_t s = 0; s < k; s++) {
            const double p = row[dependent[s]], *restrict from = G + s * left;
            pull += p * W[s * width + n];
            for (int64_t j = 0; j < left; j++) to[j] += 0.5 * p * from[j];
        }
        multipliers[r] = pull;
    }
    for (int64_t i = 0; i < left; i++) {
        const double *row = P + free[i] * n;
        double sum = g[free[i]];
        for (int64_t r = 0; r < k; r++)
            sum += row[dependent[r]] * W[r * width + n] + G[r * left + i] * multipliers[r];
        f[i] = sum;
        double *restrict to = H + i * left;
        for (int64_t j = 0; j < left; j++) to[j] = 0.0;
        for (int64_t r = 0; r < k; r++) {
            const double p = G[r * left + i], q = half[r * left + i];
            const double *restrict one = half + r * left, *restrict two = G + r * left;
            for (int64_t j = i; j < left; j++) to[j] += p * one[j] + q * two[j];
        }
        for (int64_t j = i; j < left; j++) to[j] += row[free[j]];
        up[i] = clamp(upper[free[i]]), low[i] = clamp(lower[free[i]]);
    }
    for (int64_t i = 0; i < left; i++)
        for (int64_t j = 0; j < i; j++) H[i * left + j] = H[j * left + i];
    for (int64_t r = 0; r < k; r++) { /* rows without bounds are left out */
        const int64_t d = dependent[r];
        if (upper[d] == INFINITY && lower[d] == -INFINITY) continue;
        up[bounded] = clamp(upper[d] - W[r * width + n]);
        low[bounded] = clamp(lower[d] - W[r * width + n]);
        memcpy(rows + (bounded++ - left) * left, G + r * left, left * sizeof *G);
    }
    memset(sense, 0, n * sizeof *sense);
    daqp_problem problem = {(int)left, (int)bounded, (int)left, H, f, rows, up, low, sense, 0, 0, 0};
    daqp_result result;
    memset(&result, 0, sizeof result);
    result.x = answer, result.multipliers = multipliers;
    quadprog(&result, &problem, plan->settings);
    if (result.flag != 1) return UNSOLVED;

    for (int64_t i = 0; i < left; i++) x[free[i]] = answer[i], z[free[i]] = multipliers[i];
    bounded = left;
    for (int64_t r = 0; r < k; r++) {
        const int64_t d = dependent[r];
        double sum = W[r * width + n];
        for (int64_t j = 0; j < left; j++) sum += G[r * left + j] * answer[j];
        x[d] = sum;
        z[d] = upper[d] == INFINITY && lower[d] == -INFINITY ? 0.0 : multipliers[bounded++];
        y[r] = 0.0;
    }
    for (int64_t r = 0; r < k; r++) { /* A_d' y = -(P x + g + z)_d, and W holds the inverse of A_d */
        const int64_t d = dependent[r];
        double sum = g[d] + z[d];
        for (int64_t j = 0; j < n; j++) sum += P[d * n + j] * x[j];
        for (int64_t s = 0; s < k; s++) y[s] -= W[r * width + n + 1 + s] * sum;
    }
    residuals(n, k, P, A, g, lower, upper, b, x, y, z, z + n);
    z[n + 3] = result.iterations;
    return DONE;
}

int wbc_tick(const wbc_plan *plan, const double *state, const double *q, const double *v,
             int64_t moving) {
    const int found = wbc_problem(plan, state, q, v, moving);
    return found == DONE ? wbc_solve(plan) : found;
}
