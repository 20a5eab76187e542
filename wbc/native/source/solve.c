/* The QP of a plain tick solved by DAQP, its equalities eliminated first, and the answer checked.
 *
 * Gauss-Jordan elimination with pivots by column turns A x = b into x_d = G x_i + h. What is left,
 *
 *     minimise 1/2 x_i' H x_i + g' x_i    subject to the bounds of x_i, those of x_d as rows of G,
 *                                         and C x = (C_i + C_d G) x_i + C_d h
 *
 * has no equalities and a third fewer unknowns. Multipliers of A follow from the gradient, and the
 * KKT residuals are those of the full QP: what wbc/qp/kkt.py computes.
 */
#include "active_set.h"
#include "linear.h"
#include "margin.h"
#include "tree.h"

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

static const int64_t NO_ANSWER = -100, NO_POINT = -1; /* NO_POINT: DAQP's exit flag as well */
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

/* What is left of a QP without its equalities, in scratch memory. */
typedef struct {
    int64_t left;          /* unknowns x_i: order[k..n) */
    int64_t *order;        /* x_d, then x_i */
    double *W;             /* (k, n + 1): reduced A, with the inverse of A_d in its place, and h */
    double *G, *half;      /* (k, left) each, one behind the other */
    double *H, *f;         /* (left, left), (left) */
    double *low, *up;      /* (left + m + k): bounds, C, then the bounded x_d */
    double *rows;          /* (m + k, left) */
    double *multipliers, *answer;
    double *factor;        /* (2 k) */
    double *gradient;      /* (n), of the full QP */
    double *triangle;      /* (left, left + 1): see least */
    double *end;           /* of the memory */
    int *sense;
} reduced;

static void place(const wbc_qp *qp, double *scratch, int64_t *order, reduced *r) {
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
WIDE static int64_t eliminate(const wbc_qp *qp, const reduced *of, int64_t *usual) {
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
    return 0;
}

/* H = P_ii + G' half + half' G with half = P_di + 1/2 P_dd G; f = g_i + P_id h + G' (..) */
WIDE static void reduce_cost(const wbc_qp *qp, const reduced *r) {
    const int64_t n = qp->n, k = qp->k, left = r->left, width = n + 1;
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
        add_rows(left, k, r->factor, r->G, left, to);
        r->multipliers[d] = pull;
    }
    for (int64_t i = 0; i < left; i++) {
        const double *row = P + free[i] * n;
        double sum = qp->g[free[i]], *restrict to = r->H + i * left;
        for (int64_t d = 0; d < k; d++)
            sum += row[dependent[d]] * W[d * width + n] + r->G[d * left + i] * r->multipliers[d];
        r->f[i] = sum;
        for (int64_t j = i; j < left; j++) to[j] = row[free[j]];
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
        add_rows(left, k, r->factor, r->G, left, to);
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

/* x, y, z, z_box of the full QP from the answer of the reduced one. */
static void lift(const wbc_qp *qp, const reduced *r) {
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

/* The velocity at x with a base's that meets its dynamics to rounding, and the torques at that. */
static void command(const wbc_plan *plan, const wbc_qp *qp) {
    const int64_t n = qp->n, nv = plan->tree->nv;
    double missed[6], turn[6], triangle[42];
    for (int i = 0; i < 6; i++) missed[i] = dot(n, qp->D + i * n, qp->x) + qp->offset[i];
    least(6, qp->D, n, missed, triangle, turn); /* the base's inertia times turn = -missed */
    for (int i = 0; i < 6; i++) qp->exact[i] = qp->x[i] + turn[i];
    memcpy(qp->exact + 6, qp->x + 6, (nv - 6) * sizeof *qp->x);
    for (int64_t i = 6; i < nv; i++) {
        const double *row = qp->D + i * n;
        const double sum = dot(6, row, qp->exact) + dot(n - 6, row + 6, qp->x + 6);
        qp->torque[i - 6] = plan->unit * (sum + qp->offset[i]);
    }
}

/* How many bounds and rows are left. */
static int64_t bounds_left(const wbc_qp *qp, const reduced *r) {
    int64_t bounded = r->left + qp->m;
    for (int64_t s = 0; s < qp->k; s++) bounded += !is_free(qp, r->order[s]);
    return bounded;
}

/* Leave the QP without its equalities; returns the number of its bounds and rows, or why it cannot be. */
static int64_t reduce(const wbc_qp *qp, const reduced *r, int64_t *usual) {
    const int64_t said = r->left < 1 ? NO_ANSWER : eliminate(qp, r, usual);
    if (said < 0) return said;
    reduce_cost(qp, r);
    return reduce_bounds(qp, r);
}

/* Whether the optimum of the cost alone keeps all bounds and rows: then it is the optimum. */
WIDE static int is_kept(const reduced *r, int64_t bounded) {
    if (!least(r->left, r->H, r->left, r->f, r->triangle, r->answer)) return 0;
    for (int64_t i = 0; i < bounded; i++) {
        const int64_t row = i - r->left;
        const double value =
            row < 0 ? r->answer[i] : dot(r->left, r->rows + row * r->left, r->answer);
        if (!(value >= r->low[i] && value <= r->up[i])) return 0;
        r->multipliers[i] = 0.0;
    }
    return 1;
}

/* Solve what is left by DAQP; returns its iterations, or its exit flag below 0: no answer. The
 * iterations are the first thing found either way. */
static int64_t ask(const reduced *r, int64_t bounded, const void *address, void *settings,
                   double *found) {
    daqp_quadprog *quadprog;
    memcpy(&quadprog, &address, sizeof quadprog); /* ISO C has no cast to a function */
    if (!quadprog) return NO_ANSWER;
    memset(r->sense, 0, bounded * sizeof *r->sense);
    daqp_problem problem = {(int)r->left, (int)bounded, (int)r->left, r->H, r->f, r->rows,
                            r->up,        r->low,       r->sense,     0,    0,    0};
    daqp_result result;
    memset(&result, 0, sizeof result);
    result.x = r->answer, result.multipliers = r->multipliers;
    quadprog(&result, &problem, settings);
    *found = result.iterations;
    return result.flag == 1 ? result.iterations : result.flag < 0 ? result.flag : NO_ANSWER;
}

/* x, y, z, z of the box, the three residuals and the number of iterations of a QP. */
static int conclude(const wbc_qp *qp, const reduced *r, const double *give, int64_t iterations) {
    lift(qp, r);
    residuals(qp, give, r->gradient);
    qp->found[3] = (double)iterations;
    for (int i = 0; i < 3; i++)
        if (!(qp->found[i] <= qp->eps)) return UNSOLVED; /* NaN is not */
    return DONE;
}

/* What a tick is made of besides, and where it leads. */
static int finish(const wbc_plan *plan, const double *q, const double *v, const wbc_qp *qp,
                  const reduced *r) {
    if (!is_measured(qp->x, plan->tree->nv)) return UNSOLVED; /* no robot's velocity */
    if (plan->torque) command(plan, qp);
    int64_t *pairs = usual_columns(plan, qp) + qp->k;
    return plan->margin && leads_inside(plan, q, v, qp, r->end, pairs) ? LEADS_INSIDE : DONE;
}

int wbc_answer(const wbc_plan *plan, const double *q, const double *v, const double *x,
               const double *z, double scale, int64_t iterations) {
    wbc_qp qp;
    reduced r;
    lay_out(plan, &qp);
    place(&qp, plan->scratch, plan->order, &r);
    const int64_t bounded = bounds_left(&qp, &r), rows = bounded - r.left;
    if (x) {
        memcpy(r.answer, x, r.left * sizeof *x);
        for (int64_t i = 0; i < r.left; i++) r.multipliers[i] = z[rows + i] / scale;
        for (int64_t i = 0; i < rows; i++) r.multipliers[r.left + i] = z[i] / scale;
    } else
        iterations = ask(&r, bounded, plan->quadprog, plan->settings, qp.found);
    qp.found[3] = (double)iterations;
    if (iterations < 0 || conclude(&qp, &r, 0, iterations) != DONE) return UNSOLVED;
    return finish(plan, q, v, &qp, &r);
}

int wbc_tick(const wbc_plan *plan, const double *state, const double *q, const double *v,
             int64_t moving) {
    const int found = wbc_problem(plan, state, q, v, moving);
    if (found != DONE) return found;
    wbc_qp qp;
    reduced r;
    lay_out(plan, &qp);
    place(&qp, plan->scratch, plan->order, &r);
    const int64_t bounded = reduce(&qp, &r, plan->outside ? usual_columns(plan, &qp) : 0);
    if (bounded < 0) {
        qp.found[0] = 0.0, qp.found[3] = (double)bounded;
        return UNSOLVED;
    }
    if (is_kept(&r, bounded) && conclude(&qp, &r, 0, 0) == DONE) return finish(plan, q, v, &qp, &r);
    qp.found[0] = (double)(bounded - r.left);
    return plan->outside ? REDUCED : wbc_answer(plan, q, v, 0, 0, 1.0, 0);
}

int wbc_reduced(const wbc_plan *plan, int64_t *begin) {
    wbc_qp qp;
    reduced r;
    lay_out(plan, &qp);
    place(&qp, plan->scratch, plan->order, &r);
    const double *every[] = {r.H, r.f, r.low, r.up, r.rows};
    for (int i = 0; i < 5; i++) begin[i] = every[i] - plan->scratch;
    return DONE;
}

int wbc_solve_qp(const wbc_qp *qp, double *scratch, int64_t *order, const void *quadprog,
                 void *settings) {
    if (!is_qp(qp)) return NOT_FINITE;
    reduced r;
    place(qp, scratch, order, &r);
    const int64_t bounded = reduce(qp, &r, 0);
    const int64_t iterations = bounded < 0 ? bounded : ask(&r, bounded, quadprog, settings, qp->found);
    qp->found[3] = (double)iterations;
    return iterations < 0 ? UNSOLVED : conclude(qp, &r, 0, iterations);
}

int wbc_solve_giving(const wbc_qp *qp, const double *give, int64_t most, double *scratch,
                     int64_t *order) {
    if (!is_qp(qp)) return NOT_FINITE;
    reduced r;
    place(qp, scratch, order, &r);
    const int64_t bounded = reduce(qp, &r, 0);
    if (bounded < 0) return UNSOLVED;
    double *every = r.end; /* of bounds, which do not give way, and rows */
    memset(every, 0, bounded * sizeof *every);
    memcpy(every + r.left, give, qp->m * sizeof *give);
    const int64_t iterations =
        active_set_solve(r.left, bounded, r.H, r.f, r.rows, r.low, r.up, every, most,
                         every + bounded, order + 2 * qp->n + qp->m, r.answer, r.multipliers);
    return iterations < 0 ? UNSOLVED : conclude(qp, &r, give, iterations);
}
