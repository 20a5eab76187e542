/* A dual active-set method for strictly convex QPs in which rows may give way at a cost.
 *
 *     minimise 1/2 x'H x + f'x + 1/2 sum s_i^2 / give_i    subject to low <= R x - s <= up
 *
 * with s_i = 0 where give_i is 0. As unknowns the slacks would make the QP several times as large;
 * here a row that gives way is one number on the diagonal of a matrix. With H = U'U and y = U x +
 * U^-T f the rows are M y - s, M = R U^-1, here of unit length, and the multipliers of the active
 * rows W solve (M_W M_W' + give_W) z = -b_W. They are followed from one active set to the next
 * (Arnstrom, Bemporad & Axehall, IEEE Trans. Automatic Control 67(8), 2022), with an LDL'
 * factorisation that rows are added to and taken from (Gill et al., Math. Comp. 28, 1974).
 */
#include "active_set.h"
#include "linear.h"

#include <math.h>
#include <string.h>

/* Of rows of unit length: what is met, what makes a row depend on others, multipliers of 0. */
static const double MET = 1e-10, DEPENDENT = 1e-12, NOTHING = 1e-13;
static const double DOUBTFUL = 1e-6; /* what is left of a row's square below this may be rounding */
static const double ROUNDED = 1e-15; /* part of the largest multiplier that a row may be missed by */
static const double ROUNDING = 1e-7; /* of a direction in which dependent rows outweigh each other */
static const double SHORTEST = 1e-12; /* rows below this, where the cost is of unit curvature */
/* By how much all rows that contradict each other, of unit length as they were given, would have to
 * give way, by their largest end: less may be rounding. */
static const double CONTRADICTED = 1e-7;

/* Missed by rounding: left out, and looked at again so often; at last it is judged with the answer. */
enum { DOUBTED = 3, AGAIN = 5 };

enum { REFINED = 2 }; /* so often */

/* Rows are looked at again if they are missed by more than this part of the worst; so many beside the
 * worst are added with it if they are missed by more than that part: a fifth fewer steps. */
static const double NOTED = 0.3, BESIDE = 0.5;
enum { MORE = 3 };

typedef struct {
    int64_t n, m, size; /* size: of the active set */
    double *U, *inverse;        /* (n, n): the transpose of U above, lower; U^-1, upper */
    double *v, *y, *left;       /* (n): U^-T f, y, and what other rows leave of one */
    double *M;                  /* (m, n) */
    double *low, *up, *give, *length;  /* (m) */
    double *z, *wanted;                /* (m), of the active ones */
    double *diagonal, *w, *L;          /* (m), (m), rows of L one behind the other */
    double *forward; /* (m) L^-1 of what is wanted of the active rows, the first known of them */
    int64_t known;
    int64_t candidates, *candidate; /* (m) */
    double worst, *by;              /* by how much rows are missed: most, and (m) the candidates */
    int64_t *active, *side; /* (m); side of a row: 0 is not active, 1 up, -1 low, 2 both, or DOUBTED */
} active_set;

static double *row_of(const active_set *a, int64_t k) {
    return a->L + k * (k - 1) / 2;
}

/* wanted = L^-T wanted */
WIDE static void back(active_set *a) {
    double *restrict x = a->wanted;
    for (int64_t j = a->size - 1; j > 0; j--) {
        const double *l = row_of(a, j), factor = x[j];
        for (int64_t c = 0; c < j; c++) x[c] -= factor * l[c];
    }
}

/* What the active rows leave of a row's square, of which l is the row of L: a sum of squares, where the
 * difference that is usually taken has lost its digits. */
WIDE static double left_of(active_set *a, int64_t row, const double *l) {
    double soft = a->give[row];
    memcpy(a->wanted, l, a->size * sizeof *l);
    back(a);
    memset(a->left, 0, a->n * sizeof *a->left);
    add_numbered(a->n, a->n, a->size, a->wanted, a->active, a->M, 0, a->left);
    for (int64_t i = 0; i < a->n; i++) a->left[i] -= a->M[row * a->n + i];
    for (int64_t j = 0; j < a->size; j++)
        soft += a->give[a->active[j]] * a->wanted[j] * a->wanted[j];
    return dot(a->n, a->left, a->left) + soft;
}

/* Add a row to the factorisation; whether it depends on those that are active. */
WIDE static int add(active_set *a, int64_t row, int64_t side) {
    const int64_t k = a->size, n = a->n;
    double *restrict l = row_of(a, k), *restrict w = a->w;
    const double *own = a->M + row * n;
    double rest = dot(n, own, own) + a->give[row];
    for (int64_t j = 0; j < k; j++)
        w[j] = dot(n, own, a->M + a->active[j] * n) - dot(j, row_of(a, j), w);
    for (int64_t j = 0; j < k; j++) {
        l[j] = a->diagonal[j] > 0.0 ? w[j] / a->diagonal[j] : 0.0;
        rest -= l[j] * w[j];
    }
    if (rest < DOUBTFUL) rest = left_of(a, row, l);
    const int depends = a->give[row] == 0.0 && !(rest > DEPENDENT);
    /* What gives way leaves at least that, whatever rounding says. */
    a->diagonal[k] = depends ? 0.0 : rest > a->give[row] ? rest : a->give[row];
    a->z[k] = 0.0, a->active[k] = row, a->side[row] = side;
    a->size++;
    return depends;
}

/* Take the active row number p away; whether the last one depends on the others still. */
WIDE static int drop(active_set *a, int64_t p) {
    const int64_t last = --a->size;
    double by = a->diagonal[p], *restrict w = a->w;
    a->side[a->active[p]] = 0;
    if (p < a->known) a->known = p;
    for (int64_t r = p; r < last; r++) { /* rows move up, without the entry of column p */
        const double *from = row_of(a, r + 1);
        double *to = row_of(a, r);
        w[r] = from[p];
        for (int64_t c = 0; c < p; c++) to[c] = from[c];
        for (int64_t c = p; c < r; c++) to[c] = from[c + 1];
        a->diagonal[r] = a->diagonal[r + 1], a->z[r] = a->z[r + 1];
        a->active[r] = a->active[r + 1];
    }
    for (int64_t j = p; j < last; j++) { /* by w w' is added to what is behind */
        const double entry = w[j], old = a->diagonal[j], now = old + by * entry * entry;
        a->diagonal[j] = now;
        if (!(now > 0.0)) continue;
        const double part = by * entry / now;
        by *= old / now;
        for (int64_t r = j + 1; r < last; r++) {
            double *l = row_of(a, r) + j;
            w[r] -= entry * *l;
            *l += part * w[r];
        }
    }
    if (last == 0) return 0;
    const double give = a->give[a->active[last - 1]];
    const int depends = give == 0.0 && !(a->diagonal[last - 1] > DEPENDENT);
    if (depends) a->diagonal[last - 1] = 0.0;
    return depends;
}

/* wanted = S^-1 wanted, S = M_W M_W' + give_W, from what L^-1 wanted is of the rows before begin. */
WIDE static void solve(active_set *a, double *restrict forward, int64_t begin) {
    for (int64_t j = begin; j < a->size; j++)
        forward[j] = a->wanted[j] - dot(j, row_of(a, j), forward);
    for (int64_t j = 0; j < a->size; j++) a->wanted[j] = forward[j] / a->diagonal[j];
    back(a);
}

/* The multipliers at which all active rows are met. */
static void want(active_set *a) {
    for (int64_t j = a->known; j < a->size; j++) {
        const int64_t row = a->active[j];
        a->wanted[j] = -(a->side[row] < 0 ? a->low : a->up)[row];
    }
    solve(a, a->forward, a->known);
    a->known = a->size;
}

/* Take from the multipliers, and from y itself, what rounding leaves active rows missed by: multipliers may
 * be so large that y, summed anew, is no better. */
WIDE static void refine(active_set *a) {
    for (int64_t j = 0; j < a->size; j++) {
        const int64_t row = a->active[j];
        a->wanted[j] = dot(a->n, a->M + row * a->n, a->y) - a->give[row] * a->z[j] -
                       (a->side[row] < 0 ? a->low : a->up)[row];
    }
    solve(a, a->w, 0);
    for (int64_t j = 0; j < a->size; j++) a->z[j] += a->wanted[j], a->w[j] = -a->wanted[j];
    add_numbered(a->n, a->n, a->size, a->w, a->active, a->M, 0, a->y);
}

/* Go towards what is wanted (or, endless, along it) until a multiplier would change its sign.
 * Returns which, or -1: none does. */
static int64_t go(active_set *a, int endless) {
    int64_t first = -1;
    double most = endless ? INFINITY : 1.0;
    for (int64_t j = 0; j < a->size; j++) {
        const int64_t side = a->side[a->active[j]];
        if (side == 2) continue;
        const double z = side * a->z[j], step = side * a->wanted[j] - (endless ? 0.0 : z);
        if (endless ? !(step < -ROUNDING) : !(z + step < -NOTHING) || !(step < 0.0)) continue;
        const double part = z > 0.0 ? -z / step : 0.0;
        if (part < most) most = part, first = j;
    }
    if (first < 0 && endless) return -1;
    for (int64_t j = 0; j < a->size; j++)
        a->z[j] += most * (a->wanted[j] - (endless ? 0.0 : a->z[j]));
    return first;
}

/* Above its upper (positive) or below its lower end, by how much a row is missed; else not above 0. */
INLINE double missed_by(const active_set *a, int64_t row, int64_t *side) {
    const double value = dot(a->n, a->M + row * a->n, a->y);
    const double above = value - a->up[row], below = a->low[row] - value;
    *side = a->up[row] == a->low[row] ? 2 : above > below ? 1 : -1;
    return above > below ? above : below;
}

/* y, and the row that is missed by most of the candidates; -1: all are met. Where no candidate is
 * missed all are looked at, and those missed by much are the next candidates: many never are. */
WIDE static int64_t missed(active_set *a, int64_t *side) {
    double met = MET;
    int64_t found = -1, its = 0;
    memset(a->y, 0, a->n * sizeof *a->y);
    for (int64_t j = 0; j < a->size; j++) {
        if (ROUNDED * fabs(a->z[j]) > met) met = ROUNDED * fabs(a->z[j]);
        a->w[j] = -a->z[j];
    }
    add_numbered(a->n, a->n, a->size, a->w, a->active, a->M, 0, a->y);
    a->worst = met;
    for (int64_t c = 0; c < a->candidates; c++) {
        const int64_t i = a->candidate[c];
        a->by[c] = a->side[i] ? 0.0 : missed_by(a, i, &its);
        if (a->by[c] > a->worst) a->worst = a->by[c], found = i, *side = its;
    }
    if (found >= 0) return found;
    int64_t count = 0;
    for (int64_t i = 0; i < a->m; i++) {
        const double by = a->side[i] ? 0.0 : missed_by(a, i, &its);
        if (by > met) a->by[count] = by, a->candidate[count++] = i;
        if (by > a->worst) a->worst = by, found = i, *side = its;
    }
    a->candidates = 0;
    for (int64_t c = 0; c < count; c++) {
        if (a->by[c] < NOTED * a->worst) continue;
        a->by[a->candidates] = a->by[c], a->candidate[a->candidates++] = a->candidate[c];
    }
    return found;
}

/* U, v, M and bounds where the cost is 1/2 |y|^2; false if the cost is not strictly convex. */
WIDE static int transform(active_set *a, const double *H, const double *f, const double *rows,
                          const double *low, const double *up) {
    const int64_t n = a->n;
    for (int64_t i = 0; i < n; i++) {
        double *u = a->U + i * n;
        for (int64_t j = 0; j < i; j++)
            u[j] = (H[i * n + j] - dot(j, u, a->U + j * n)) / a->U[j * n + j];
        const double square = H[i * n + i] - dot(i, u, u);
        if (!(square > 0.0)) return 0;
        u[i] = sqrt(square);
        a->v[i] = (f[i] - dot(i, u, a->v)) / u[i];
    }
    for (int64_t r = 0; r < n; r++) {
        double *restrict to = a->inverse + r * n;
        memset(to, 0, n * sizeof *to);
        to[r] = 1.0 / a->U[r * n + r];
        for (int64_t j = r + 1; j < n; j++)
            to[j] = -dot(j - r, a->U + j * n + r, to + r) / a->U[j * n + j];
    }
    for (int64_t r = 0; r < a->m; r++) {
        double *restrict to = a->M + r * n;
        if (r < n) { /* a bound */
            memcpy(to, a->inverse + r * n, n * sizeof *to);
            if (low[r] == -INFINITY && up[r] == INFINITY) {
                a->low[r] = low[r], a->up[r] = up[r], a->length[r] = 1.0;
                continue;
            }
        } else { /* most entries of cones and limits are 0 */
            const double *row = rows + (r - n) * n;
            int64_t count = 0;
            for (int64_t c = 0; c < n; c++)
                if (row[c] != 0.0) a->w[count] = row[c], a->candidate[count++] = c;
            memset(to, 0, n * sizeof *to);
            add_numbered(n, n, count, a->w, a->candidate, a->inverse, 1, to);
        }
        const double length = sqrt(dot(n, to, to)), shift = dot(n, to, a->v);
        const double by = length > SHORTEST ? length : 1.0;
        a->length[r] = by;
        for (int64_t j = 0; j < n; j++) to[j] /= by;
        a->low[r] = (low[r] + shift) / by, a->up[r] = (up[r] + shift) / by;
        a->give[r] /= by * by;
    }
    return 1;
}

/* Add candidates missed by nearly as much as the worst row, if they do not depend on what is active:
 * those that are not wanted are the first to be dropped. */
static void add_more(active_set *a) {
    for (int64_t c = 0, more = MORE; c < a->candidates && more > 0 && a->size < a->m; c++) {
        const int64_t row = a->candidate[c];
        int64_t side;
        if (a->side[row] || a->by[c] < BESIDE * a->worst) continue;
        missed_by(a, row, &side);
        if (add(a, row, side)) a->side[a->active[--a->size]] = 0;
        more--;
    }
}

/* Whether what is wanted of an active row does not point at the side that it is held on: by rounding, as
 * go has seen, or 0, which would stand beside an end that need not be finite. */
static int against(const active_set *a, int64_t j) {
    const int64_t side = a->side[a->active[j]];
    return side != 2 && !(side * a->wanted[j] > 0.0);
}

/* Whether the active rows contradict each other: what is wanted of them adds up to no row, and to an
 * end below 0. Then it is written to z (m), a certificate by the rows as they were given. */
static int contradict(const active_set *a, const double *rows, const double *low, const double *up,
                      double *z) {
    double sum = 0.0, all = 0.0, largest = 0.0;
    for (int64_t j = 0; j < a->size; j++) {
        const int64_t i = a->active[j];
        const double *row = rows + (i - a->n) * a->n;
        const double norm = i < a->n ? 1.0 : sqrt(dot(a->n, row, row));
        if (against(a, j)) continue;
        const double weight = a->wanted[j] / a->length[i], end = weight < 0.0 ? low[i] : up[i];
        sum += weight * end, all += fabs(weight) * norm;
        if (norm > 0.0 && fabs(end) / norm > largest) largest = fabs(end) / norm;
    }
    if (!(-sum > CONTRADICTED * (1.0 + largest) * all)) return 0;
    memset(z, 0, a->m * sizeof *z);
    for (int64_t j = 0; j < a->size; j++) {
        const int64_t i = a->active[j];
        z[i] = against(a, j) ? 0.0 : a->wanted[j] / a->length[i];
    }
    return 1;
}

int64_t active_set_numbers(int64_t n, int64_t m) {
    return 3 * n + 10 * m + 2 * n * n + m * n + m * (m - 1) / 2;
}

int64_t active_set_solve(int64_t n, int64_t m, const double *H, const double *f,
                         const double *rows, const double *low, const double *up,
                         const double *give, int64_t most, double *scratch, int64_t *order,
                         double *x, double *z) {
    active_set a = {.n = n, .m = m, .active = order, .side = order + m,
                    .candidate = order + 2 * m};
    double **parts[] = {&a.v, &a.y, &a.left, &a.low, &a.up, &a.give, &a.length, &a.z, &a.wanted,
                        &a.diagonal, &a.w, &a.forward, &a.by};
    for (int i = 0; i < 13; i++) *parts[i] = scratch, scratch += i < 3 ? n : m;
    a.U = scratch, a.inverse = a.U + n * n, a.M = a.inverse + n * n, a.L = a.M + m * n;
    memset(a.side, 0, m * sizeof *a.side);
    memcpy(a.give, give, m * sizeof *give);
    if (!transform(&a, H, f, rows, low, up)) return NO_ANSWER;
    int depends = 0, doubted = 0, again = AGAIN;
    for (int64_t iterations = 1; iterations <= most; iterations++) {
        if (depends) {
            memset(a.wanted, 0, a.size * sizeof *a.wanted);
            const int64_t last = a.size - 1, side = a.side[a.active[last]];
            /* A row that has to be met on both sides was missed on one of them. */
            const double value = dot(n, a.M + a.active[last] * n, a.y);
            a.wanted[last] = side == 2 ? (value > a.up[a.active[last]] ? 1.0 : -1.0) : side;
            back(&a);
        } else
            want(&a);
        const int64_t blocked = go(&a, depends);
        if (blocked >= 0) {
            depends = drop(&a, blocked);
            continue;
        }
        if (depends) { /* no point meets it, or it is missed by rounding, at a corner of many rows */
            if (contradict(&a, rows, low, up, z)) return NO_POINT;
            a.side[a.active[--a.size]] = DOUBTED;
            if (a.size < a.known) a.known = a.size;
            doubted = 1, depends = 0;
        }
        int64_t side = 0;
        const int64_t row = missed(&a, &side);
        if (row < 0 && doubted && again-- > 0) {
            for (int64_t i = 0; i < m; i++)
                if (a.side[i] == DOUBTED) a.side[i] = 0;
            doubted = 0;
            continue;
        }
        if (row < 0) {
            for (int i = 0; i < REFINED; i++) refine(&a);
            memset(z, 0, m * sizeof *z);
            for (int64_t j = 0; j < a.size; j++)
                z[a.active[j]] = a.z[j] / a.length[a.active[j]];
            for (int64_t i = n - 1; i >= 0; i--) { /* U x = y - v */
                x[i] = a.y[i] - a.v[i];
                for (int64_t j = i + 1; j < n; j++) x[i] -= a.U[j * n + i] * x[j];
                x[i] /= a.U[i * n + i];
            }
            return iterations;
        }
        if (a.size > n && a.size >= m) return NO_ANSWER;
        depends = add(&a, row, side);
        if (!depends) add_more(&a);
    }
    return NO_ANSWER;
}
