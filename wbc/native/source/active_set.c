/* A dual active-set method for strictly convex QPs with soft rows.
 *
 *     minimise 1/2 x'H x + f'x + 1/2 sum s_i^2 / c_i    subject to low <= R x - s <= up
 *
 * with s_i = 0 where the compliance c_i is 0. As unknowns the slacks would make the QP several times as large;
 * here a soft row is one number on the diagonal of a matrix. With H = U'U and y = U x + U^-T f the rows are
 * M y - s, M = R U^-1, scaled to unit length, and the multipliers of the active rows W solve
 * (M_W M_W' + c_W) z = -b_W. They change from one active set to the next (Arnstrom, Bemporad & Axehall, IEEE
 * Trans. Automatic Control 67(8), 2022), with an LDL' factorisation to which rows are added and from which they
 * are removed (Gill et al., Math. Comp. 28, 1974).
 */
#include "active_set.h"
#include "linear.h"

#include <math.h>
#include <string.h>

/* For rows of unit length: tolerance of feasibility and of dependence; multipliers that count as 0. */
static const double FEASIBLE = 1e-10, DEPENDENT = 1e-12, ZERO = 1e-13;
static const double CANCELLED = 1e-6;       /* a square that elimination leaves below this may be cancellation only */
static const double ROUNDING_SHARE = 1e-15; /* tolerated violation by the largest multiplier */
static const double ROUNDING = 1e-7;        /* components of a direction of infeasibility below this count as 0 */
static const double SHORTEST = 1e-12;       /* shorter rows, in the metric of the cost, are not normalised */
/* Rows of unit length contradict each other if together they miss a point by this part of their largest bound; less
 * may be rounding. */
static const double CONTRADICTED = 1e-7;

/* A row violated by rounding only is set aside, and tried again so often; the KKT residuals judge the solution. */
enum { SET_ASIDE = 3, RETRIES = 5 };

enum { REFINEMENTS = 2 }; /* steps of refinement of a solution */

/* Candidates are rows violated by this share of the worst; up to BATCH of them, violated by that share, are added
 * with the worst: a fifth fewer steps. */
static const double CANDIDATE_SHARE = 0.3, BATCH_SHARE = 0.5;
enum { BATCH = 3 };

typedef struct {
    int64_t n, m, size;                     /* of the active set */
    double *U, *inverse;                    /* (n, n): U', lower; U^-1, upper */
    double *v, *y, *left;                   /* (n): U^-T f, y, and what elimination leaves of a row */
    double *M;                              /* (m, n) */
    double *low, *up, *compliance, *length; /* (m) */
    double *z, *target;                     /* (m), of the active rows */
    double *diagonal, *w, *L;               /* (m), (m), rows of L one behind the other */
    double *forward;                        /* (m) L^-1 target of the active rows, of which the first are known */
    int64_t known;
    int64_t candidates, *candidate; /* (m) */
    double worst, *violation;       /* largest violation, and (m) of the candidates */
    int64_t *active, *side;         /* (m); of each row: 0 inactive, 1 up, -1 low, 2 equality, or SET_ASIDE */
} active_set;

static double *factor_row(const active_set *a, int64_t k) { return a->L + k * (k - 1) / 2; }

/* target = L^-T target */
WIDE static void back_substitute(active_set *a) {
    double *restrict x = a->target;
    for (int64_t j = a->size - 1; j > 0; j--) {
        const double *l = factor_row(a, j), factor = x[j];
        for (int64_t c = 0; c < j; c++) x[c] -= factor * l[c];
    }
}

/* The square of what the active rows leave of a row with the row l of L: as a sum of squares, since the usual
 * difference has lost its digits. */
WIDE static double remaining_square(active_set *a, int64_t row, const double *l) {
    double soft = a->compliance[row];
    memcpy(a->target, l, a->size * sizeof *l);
    back_substitute(a);
    memset(a->left, 0, a->n * sizeof *a->left);
    add_numbered(a->n, a->size, a->target, a->active, a->M, 0, a->left);
    for (int64_t i = 0; i < a->n; i++) a->left[i] -= a->M[row * a->n + i];
    for (int64_t j = 0; j < a->size; j++) soft += a->compliance[a->active[j]] * a->target[j] * a->target[j];
    return dot(a->n, a->left, a->left) + soft;
}

/* Add a row to the factorisation; returns whether it depends on the active ones. */
WIDE static int add_row(active_set *a, int64_t row, int64_t side) {
    const int64_t k = a->size, n = a->n;
    double *restrict l = factor_row(a, k), *restrict w = a->w;
    const double *own = a->M + row * n;
    double rest = dot(n, own, own) + a->compliance[row];
    for (int64_t j = 0; j < k; j++) w[j] = dot(n, own, a->M + a->active[j] * n) - dot(j, factor_row(a, j), w);
    for (int64_t j = 0; j < k; j++) {
        l[j] = a->diagonal[j] > 0.0 ? w[j] / a->diagonal[j] : 0.0;
        rest -= l[j] * w[j];
    }
    if (rest < CANCELLED) rest = remaining_square(a, row, l);
    const int depends = a->compliance[row] == 0.0 && !(rest > DEPENDENT);
    /* a lower bound, whatever rounding says */
    a->diagonal[k] = depends ? 0.0 : rest > a->compliance[row] ? rest : a->compliance[row];
    a->z[k] = 0.0, a->active[k] = row, a->side[row] = side;
    a->size++;
    return depends;
}

/* Remove the active row number p; returns whether the last one still depends on the others. */
WIDE static int drop_row(active_set *a, int64_t p) {
    const int64_t last = --a->size;
    double by = a->diagonal[p], *restrict w = a->w;
    a->side[a->active[p]] = 0;
    if (p < a->known) a->known = p;
    for (int64_t r = p; r < last; r++) { /* the rows of L move up, without column p */
        const double *from = factor_row(a, r + 1);
        double *to = factor_row(a, r);
        w[r] = from[p];
        for (int64_t c = 0; c < p; c++) to[c] = from[c];
        for (int64_t c = p; c < r; c++) to[c] = from[c + 1];
        a->diagonal[r] = a->diagonal[r + 1], a->z[r] = a->z[r + 1];
        a->active[r] = a->active[r + 1];
    }
    for (int64_t j = p; j < last; j++) { /* rank-one update by w w' behind it */
        const double entry = w[j], old = a->diagonal[j], now = old + by * entry * entry;
        a->diagonal[j] = now;
        if (!(now > 0.0)) continue;
        const double part = by * entry / now;
        by *= old / now;
        for (int64_t r = j + 1; r < last; r++) {
            double *l = factor_row(a, r) + j;
            w[r] -= entry * *l;
            *l += part * w[r];
        }
    }
    if (last == 0) return 0;
    const double compliance = a->compliance[a->active[last - 1]];
    const int depends = compliance == 0.0 && !(a->diagonal[last - 1] > DEPENDENT);
    if (depends) a->diagonal[last - 1] = 0.0;
    return depends;
}

/* target = S^-1 target, S = M_W M_W' + compliance_W; forward holds L^-1 target of the rows before begin. */
WIDE static void solve_active(active_set *a, double *restrict forward, int64_t begin) {
    for (int64_t j = begin; j < a->size; j++) forward[j] = a->target[j] - dot(j, factor_row(a, j), forward);
    for (int64_t j = 0; j < a->size; j++) a->target[j] = forward[j] / a->diagonal[j];
    back_substitute(a);
}

/* The multipliers at which all active rows are at their bounds. */
static void find_multipliers(active_set *a) {
    for (int64_t j = a->known; j < a->size; j++) {
        const int64_t row = a->active[j];
        a->target[j] = -(a->side[row] < 0 ? a->low : a->up)[row];
    }
    solve_active(a, a->forward, a->known);
    a->known = a->size;
}

/* Remove the active rows' residuals from the multipliers and from y itself: with large multipliers, summing y anew
 * is no more exact. */
WIDE static void refine(active_set *a) {
    for (int64_t j = 0; j < a->size; j++) {
        const int64_t row = a->active[j];
        a->target[j] = dot(a->n, a->M + row * a->n, a->y) - a->compliance[row] * a->z[j] -
                       (a->side[row] < 0 ? a->low : a->up)[row];
    }
    solve_active(a, a->w, 0);
    for (int64_t j = 0; j < a->size; j++) a->z[j] += a->target[j], a->w[j] = -a->target[j];
    add_numbered(a->n, a->size, a->w, a->active, a->M, 0, a->y);
}

/* Step towards the target (or, unbounded, along it) until a multiplier changes its sign. Returns its number; -1:
 * none does. */
static int64_t step_until_blocked(active_set *a, int unbounded) {
    int64_t first = -1;
    double most = unbounded ? INFINITY : 1.0;
    for (int64_t j = 0; j < a->size; j++) {
        const int64_t side = a->side[a->active[j]];
        if (side == 2) continue;
        const double z = side * a->z[j], step = side * a->target[j] - (unbounded ? 0.0 : z);
        if (unbounded ? !(step < -ROUNDING) : !(z + step < -ZERO) || !(step < 0.0)) continue;
        const double part = z > 0.0 ? -z / step : 0.0;
        if (part < most) most = part, first = j;
    }
    if (first < 0 && unbounded) return -1;
    for (int64_t j = 0; j < a->size; j++) a->z[j] += most * (a->target[j] - (unbounded ? 0.0 : a->z[j]));
    return first;
}

/* Violation of a row's upper (side 1) or lower bound (-1); not above 0 if it is feasible. */
INLINE double violation_of(const active_set *a, int64_t row, int64_t *side) {
    const double value = dot(a->n, a->M + row * a->n, a->y);
    const double above = value - a->up[row], below = a->low[row] - value;
    *side = a->up[row] == a->low[row] ? 2 : above > below ? 1 : -1;
    return above > below ? above : below;
}

/* Compute y, and return the candidate of the largest violation; -1: all rows are feasible. If no candidate is
 * violated, all rows are evaluated and the most violated become candidates: most rows never do. */
WIDE static int64_t most_violated(active_set *a, int64_t *side) {
    double tolerance = FEASIBLE;
    int64_t found = -1, side_of_row = 0;
    memset(a->y, 0, a->n * sizeof *a->y);
    for (int64_t j = 0; j < a->size; j++) {
        if (ROUNDING_SHARE * fabs(a->z[j]) > tolerance) tolerance = ROUNDING_SHARE * fabs(a->z[j]);
        a->w[j] = -a->z[j];
    }
    add_numbered(a->n, a->size, a->w, a->active, a->M, 0, a->y);
    a->worst = tolerance;
    for (int64_t c = 0; c < a->candidates; c++) {
        const int64_t i = a->candidate[c];
        a->violation[c] = a->side[i] ? 0.0 : violation_of(a, i, &side_of_row);
        if (a->violation[c] > a->worst) a->worst = a->violation[c], found = i, *side = side_of_row;
    }
    if (found >= 0) return found;
    int64_t count = 0;
    for (int64_t i = 0; i < a->m; i++) {
        const double by = a->side[i] ? 0.0 : violation_of(a, i, &side_of_row);
        if (by > tolerance) a->violation[count] = by, a->candidate[count++] = i;
        if (by > a->worst) a->worst = by, found = i, *side = side_of_row;
    }
    a->candidates = 0;
    for (int64_t c = 0; c < count; c++) {
        if (a->violation[c] < CANDIDATE_SHARE * a->worst) continue;
        a->violation[a->candidates] = a->violation[c], a->candidate[a->candidates++] = a->candidate[c];
    }
    return found;
}

/* Write U, v, M and bounds of the QP with the cost 1/2 |y|^2; false if the cost is not strictly convex. */
WIDE static int transform(active_set *a, const double *H, const double *f, const double *rows, const double *low,
                          const double *up) {
    const int64_t n = a->n;
    for (int64_t i = 0; i < n; i++) {
        double *u = a->U + i * n;
        for (int64_t j = 0; j < i; j++) u[j] = (H[i * n + j] - dot(j, u, a->U + j * n)) / a->U[j * n + j];
        const double square = H[i * n + i] - dot(i, u, u);
        if (!(square > 0.0)) return 0;
        u[i] = sqrt(square);
        a->v[i] = (f[i] - dot(i, u, a->v)) / u[i];
    }
    for (int64_t r = 0; r < n; r++) {
        double *restrict to = a->inverse + r * n;
        memset(to, 0, n * sizeof *to);
        to[r] = 1.0 / a->U[r * n + r];
        for (int64_t j = r + 1; j < n; j++) to[j] = -dot(j - r, a->U + j * n + r, to + r) / a->U[j * n + j];
    }
    for (int64_t r = 0; r < a->m; r++) {
        double *restrict to = a->M + r * n;
        if (r < n) { /* a bound */
            memcpy(to, a->inverse + r * n, n * sizeof *to);
            if (low[r] == -INFINITY && up[r] == INFINITY) {
                a->low[r] = low[r], a->up[r] = up[r], a->length[r] = 1.0;
                continue;
            }
        } else { /* cones and limits are sparse */
            const double *row = rows + (r - n) * n;
            int64_t count = 0;
            for (int64_t c = 0; c < n; c++)
                if (row[c] != 0.0) a->w[count] = row[c], a->candidate[count++] = c;
            memset(to, 0, n * sizeof *to);
            add_numbered(n, count, a->w, a->candidate, a->inverse, 1, to);
        }
        const double length = sqrt(dot(n, to, to)), shift = dot(n, to, a->v);
        const double by = length > SHORTEST ? length : 1.0;
        a->length[r] = by;
        for (int64_t j = 0; j < n; j++) to[j] /= by;
        a->low[r] = (low[r] + shift) / by, a->up[r] = (up[r] + shift) / by;
        a->compliance[r] /= by * by;
    }
    return 1;
}

/* Add candidates violated nearly as much as the worst one, if they are independent: superfluous ones are the first
 * to be dropped. */
static void add_violated_candidates(active_set *a) {
    for (int64_t c = 0, more = BATCH; c < a->candidates && more > 0 && a->size < a->m; c++) {
        const int64_t row = a->candidate[c];
        int64_t side;
        if (a->side[row] || a->violation[c] < BATCH_SHARE * a->worst) continue;
        violation_of(a, row, &side);
        if (add_row(a, row, side)) a->side[a->active[--a->size]] = 0;
        more--;
    }
}

/* Whether the direction of an active row does not point at its bound: by rounding (see step_until_blocked), or 0,
 * whose bound may be infinite. */
static int has_wrong_sign(const active_set *a, int64_t j) {
    const int64_t side = a->side[a->active[j]];
    return side != 2 && !(side * a->target[j] > 0.0);
}

/* Whether the active rows prove infeasibility: their combination by target is 0, with bounds below 0. Then write
 * that certificate, for the rows as given, to z (m). */
static int is_infeasible(const active_set *a, const double *rows, const double *low, const double *up, double *z) {
    double sum = 0.0, all = 0.0, largest = 0.0;
    for (int64_t j = 0; j < a->size; j++) {
        const int64_t i = a->active[j];
        const double *row = rows + (i - a->n) * a->n;
        const double norm = i < a->n ? 1.0 : sqrt(dot(a->n, row, row));
        if (has_wrong_sign(a, j)) continue;
        const double weight = a->target[j] / a->length[i], end = weight < 0.0 ? low[i] : up[i];
        sum += weight * end, all += fabs(weight) * norm;
        if (norm > 0.0 && fabs(end) / norm > largest) largest = fabs(end) / norm;
    }
    if (!(-sum > CONTRADICTED * (1.0 + largest) * all)) return 0;
    memset(z, 0, a->m * sizeof *z);
    for (int64_t j = 0; j < a->size; j++) {
        const int64_t i = a->active[j];
        z[i] = has_wrong_sign(a, j) ? 0.0 : a->target[j] / a->length[i];
    }
    return 1;
}

int64_t active_set_numbers(int64_t n, int64_t m) { return 3 * n + 10 * m + 2 * n * n + m * n + m * (m - 1) / 2; }

int64_t active_set_solve(int64_t n, int64_t m, const double *H, const double *f, const double *rows,
                         const double *low, const double *up, const double *compliance, int64_t most, double *scratch,
                         int64_t *order, double *x, double *z) {
    active_set a = {.n = n, .m = m, .active = order, .side = order + m, .candidate = order + 2 * m};
    double **parts[] = {&a.v, &a.y,      &a.left,     &a.low, &a.up,      &a.compliance, &a.length,
                        &a.z, &a.target, &a.diagonal, &a.w,   &a.forward, &a.violation};
    for (int i = 0; i < 13; i++) *parts[i] = scratch, scratch += i < 3 ? n : m;
    a.U = scratch, a.inverse = a.U + n * n, a.M = a.inverse + n * n, a.L = a.M + m * n;
    memset(a.side, 0, m * sizeof *a.side);
    memcpy(a.compliance, compliance, m * sizeof *compliance);
    if (!transform(&a, H, f, rows, low, up)) return NO_ANSWER;
    int depends = 0, set_aside = 0, retries = RETRIES;
    for (int64_t iterations = 1; iterations <= most; iterations++) {
        if (depends) {
            memset(a.target, 0, a.size * sizeof *a.target);
            const int64_t last = a.size - 1, side = a.side[a.active[last]];
            /* an equality was violated on one side */
            const double value = dot(n, a.M + a.active[last] * n, a.y);
            a.target[last] = side == 2 ? (value > a.up[a.active[last]] ? 1.0 : -1.0) : side;
            back_substitute(&a);
        } else find_multipliers(&a);
        const int64_t blocked = step_until_blocked(&a, depends);
        if (blocked >= 0) {
            depends = drop_row(&a, blocked);
            continue;
        }
        if (depends) { /* infeasible, or violated by rounding at a vertex of many rows */
            if (is_infeasible(&a, rows, low, up, z)) return NO_POINT;
            a.side[a.active[--a.size]] = SET_ASIDE;
            if (a.size < a.known) a.known = a.size;
            set_aside = 1, depends = 0;
        }
        int64_t side = 0;
        const int64_t row = most_violated(&a, &side);
        if (row < 0 && set_aside && retries-- > 0) {
            for (int64_t i = 0; i < m; i++)
                if (a.side[i] == SET_ASIDE) a.side[i] = 0;
            set_aside = 0;
            continue;
        }
        if (row < 0) {
            for (int i = 0; i < REFINEMENTS; i++) refine(&a);
            memset(z, 0, m * sizeof *z);
            for (int64_t j = 0; j < a.size; j++) z[a.active[j]] = a.z[j] / a.length[a.active[j]];
            for (int64_t i = n - 1; i >= 0; i--) { /* U x = y - v */
                x[i] = a.y[i] - a.v[i];
                for (int64_t j = i + 1; j < n; j++) x[i] -= a.U[j * n + i] * x[j];
                x[i] /= a.U[i * n + i];
            }
            return iterations;
        }
        if (a.size > n && a.size >= m) return NO_ANSWER;
        depends = add_row(&a, row, side);
        if (!depends) add_violated_candidates(&a);
    }
    return NO_ANSWER;
}
