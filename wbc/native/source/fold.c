/* What closed loops and gears determine is taken out of a QP before the other equalities are.
 *
 * Rows of loops speak of few unknowns: those of their own joints. By small inverses N = A_e^-1 they turn
 * into x_e = T x + t, of joints without a motor at the torque level. The dynamics of those joints are rows
 * in which the loops' forces f stand, by -A_e' exactly: they go by N' and are in no other equality. What is left
 * is the QP of a robot without loops, in size, too.
 */
#include "fold.h"
#include "linear.h"
#include "problem.h"

#include <string.h>

/* Run by run. Four at a time, written out: of a loop compilers make a call, which takes longer than a run. */
INLINE void gather_runs(const int64_t *run, const double *row, double *restrict to) {
    for (; run[1] > 0; run += 2) {
        const double *restrict from = row + run[0];
        int64_t left = run[1];
        for (; left >= 4; left -= 4, from += 4, to += 4)
            to[0] = from[0], to[1] = from[1], to[2] = from[2], to[3] = from[3];
        if (left > 1) to[0] = from[0], to[1] = from[1], from += 2, to += 2, left -= 2;
        if (left > 0) *to++ = *from;
    }
}

INLINE void gather(const folded *f, const double *row, double *to) { gather_runs(f->run, row, to); }

/* Of the first entries alone, which runs do not cross: velocities, or all. */
INLINE void gather_wide(const folded *f, const double *row, int64_t wide, double *to) {
    for (const int64_t *run = f->run; run[1] > 0 && run[0] < wide; run += 2) {
        memcpy(to, row + run[0], run[1] * sizeof *to);
        to += run[1];
    }
}

/* A cone, which is of forces alone, and of no loop's. */
INLINE void gather_cone(const wbc_plan *plan, const folded *f, const double *row, double *to) {
    const int64_t *run = f->run;
    int64_t before = 0;
    for (; run[1] > 0 && run[0] < plan->tree->nv; run += 2) before += run[1];
    memset(to, 0, before * sizeof *to);
    gather_runs(run, row, to + before);
}

INLINE int is_cone(const wbc_plan *plan, int64_t r) {
    return r >= plan->bounded && r < plan->bounded + plan->cones;
}

/* What of the unknowns that were taken out is in a row; whether any is: by their bits, which is faster. */
INLINE int taken(const folded *f, const double *row, int64_t count, double *restrict entry) {
    const int64_t loops = f->loops;
    uint64_t any = 0, bits;
    for (int64_t e = 0; e < loops; e++) entry[e] = row[f->column[e]];
    if (count > loops) memcpy(entry + loops, row + f->column[loops], (count - loops) * sizeof *entry);
    for (int64_t e = 0; e < count; e++) {
        memcpy(&bits, entry + e, sizeof bits);
        any |= bits << 1; /* but for the sign */
    }
    return any != 0;
}

/* A row of the QP as one of rest, and what of those unknowns was in it: of velocities, or of all. Returns what
 * they are at shift. */
INLINE double fold_row(const folded *f, const double *row, int64_t count, double *entry, double *restrict to) {
    const int64_t loops = f->loops, n = f->rest.n;
    gather(f, row, to);
    if (!taken(f, row, count, entry)) return 0.0;
    for (int64_t j = 0; j < f->supports; j++) to[f->support[j]] += dot(loops, entry, f->by + j * loops);
    if (count > loops) add_rows(n, loops, entry + loops, f->force, n, to);
    return dot(count, entry, f->shift);
}

/* T of velocities, -N A of what stays, where it is not 0. */
INLINE void depend(const wbc_qp *qp, int64_t nv, folded *f) {
    const int64_t loops = f->loops;
    double *sum = f->scratch, *column = sum + nv;
    memset(sum, 0, nv * sizeof *sum);
    for (int64_t i = 0; i < loops; i++)
        for (int64_t c = 0; c < nv; c++) sum[c] += fabs(qp->A[f->row[i] * qp->n + c]);
    f->supports = 0;
    for (int64_t j = 0; j < f->rest.n && f->kept[j] < nv; j++) {
        if (sum[f->kept[j]] == 0.0) continue;
        for (int64_t i = 0; i < loops; i++) column[i] = qp->A[f->row[i] * qp->n + f->kept[j]];
        for (int64_t e = 0; e < loops; e++)
            f->by[f->supports * loops + e] = -dot(loops, f->inverse + e * loops, column);
        f->support[f->supports++] = j;
    }
}

/* t of velocities, N b; T of forces, N' D of the dynamics D of joints that they move, and t by their ends. */
INLINE void balance(const wbc_qp *qp, const folded *f) {
    const int64_t n = f->rest.n, loops = f->loops;
    double *factor = f->scratch, *end = factor + loops, *dynamics = end + loops, *shift = f->shift;
    for (int64_t e = 0; e < loops; e++) end[e] = qp->b[f->row[e]];
    for (int64_t e = 0; e < loops; e++) shift[e] = dot(loops, f->inverse + e * loops, end);
    for (int64_t e = 0; e < loops; e++) {
        const int64_t r = f->row[loops + e];
        end[e] = fold_row(f, qp->A + r * qp->n, loops, factor, dynamics + e * n) - qp->b[r];
    }
    memset(f->force, 0, loops * n * sizeof *f->force);
    for (int64_t i = 0; i < loops; i++) {
        for (int64_t e = 0; e < loops; e++) factor[e] = f->inverse[e * loops + i];
        add_rows(n, loops, factor, dynamics, n, f->force + i * n);
        shift[loops + i] = dot(loops, factor, end);
    }
}

/* What of P is of velocities, folded: rows and columns of what they depend on. */
INLINE void fold_velocities(const wbc_qp *qp, const folded *f) {
    const int64_t n = f->rest.n, loops = f->loops;
    double *P = f->rest.P, *all = f->scratch, *own = all + qp->n;
    memset(P, 0, n * n * sizeof *P);
    for (int64_t i = 0; i < n; i++)
        if (f->kept[i] < qp->wide)
            gather_wide(f, qp->P + f->kept[i] * qp->n, qp->wide, P + i * n);
        else
            P[i * (n + 1)] = qp->P[f->kept[i] * (qp->n + 1)];
    for (int64_t j = 0; j < f->supports; j++) {
        const double *by = f->by + j * loops;
        const int64_t at = f->support[j];
        memset(all, 0, qp->n * sizeof *all);
        add_numbered(qp->wide, qp->n, loops, by, f->column, qp->P, 0, all);
        gather(f, all, own);
        INDEPENDENT
        for (int64_t i = 0; i < n; i++) P[at * n + i] += own[i];
        for (int64_t i = 0; i < n; i++) P[i * n + at] += own[i];
        taken(f, all, loops, own);
        for (int64_t i = 0; i < f->supports; i++) P[at * n + f->support[i]] += dot(loops, own, f->by + i * loops);
    }
}

INLINE int is_alike(int64_t n, const double *one, const double *other) {
    int64_t differs = 0;
    for (int64_t j = 0; j < n; j++) differs += (one[j] != 0.0) != (other[j] != 0.0);
    return differs == 0;
}

/* The costs of forces, which stand for themselves: squares of what they depend on, together of those that depend
 * on the same. */
INLINE void fold_forces(const wbc_qp *qp, const folded *f) {
    const int64_t n = f->rest.n, loops = f->loops;
    double *P = f->rest.P, *none = f->scratch, *weighted = none + loops + n;
    int64_t *on = f->order;
    memset(none, 0, (loops + n) * sizeof *none); /* wanted, and a gradient that nobody reads */
    for (int64_t begin = 0, end = 0; begin < loops; begin = end) {
        const double *first = f->force + begin * n;
        int64_t many = 0;
        for (int64_t j = 0; j < n; j++)
            if (first[j] != 0.0) on[many++] = j;
        double *square_of = weighted + loops * many;
        for (; end < loops && is_alike(n, first, f->force + end * n); end++) {
            const double root = sqrt(qp->P[f->column[loops + end] * (qp->n + 1)]), *force = f->force + end * n;
            for (int64_t j = 0; j < many; j++) weighted[(end - begin) * many + j] = root * force[on[j]];
        }
        memset(square_of, 0, many * many * sizeof *none);
        square(many, end - begin, weighted, none, square_of, many, none + loops);
        for (int64_t i = 0; i < many; i++) {
            P[on[i] * (n + 1)] += square_of[i * (many + 1)];
            for (int64_t j = i + 1; j < many; j++) {
                P[on[i] * n + on[j]] += square_of[i * many + j];
                P[on[j] * n + on[i]] += square_of[i * many + j];
            }
        }
    }
}

/* The gradient where x of rest is 0, as one of rest. */
INLINE void fold_gradient(const wbc_qp *qp, const folded *f) {
    const int64_t n = qp->n, loops = f->loops, count = f->count;
    double *gradient = f->gradient;
    memcpy(gradient, qp->g, n * sizeof *gradient);
    add_numbered(qp->wide, n, loops, f->shift, f->column, qp->P, 0, gradient);
    for (int64_t e = loops; e < count; e++)
        gradient[f->column[e]] += f->shift[e] * qp->P[f->column[e] * (n + 1)];
    fold_row(f, gradient, count, f->scratch, f->rest.g);
}

WIDE static void fold_all(const wbc_qp *qp, const wbc_plan *plan, folded *f) {
    const wbc_qp *rest = &f->rest;
    const int64_t n = rest->n, count = f->count;
    depend(qp, plan->tree->nv, f);
    balance(qp, f);
    fold_velocities(qp, f);
    fold_forces(qp, f);
    fold_gradient(qp, f);
    for (int64_t r = 0; r < rest->k; r++) {
        const int64_t from = f->others[r];
        rest->b[r] = qp->b[from] - fold_row(f, qp->A + from * qp->n, count, f->entry + r * count, rest->A + r * n);
    }
    for (int64_t r = 0; r < qp->m; r++) {
        double known = 0.0, *to = rest->C + r * n;
        if (is_cone(plan, r))
            gather_cone(plan, f, qp->C + r * qp->n, to);
        else
            known = fold_row(f, qp->C + r * qp->n, count, f->scratch, to);
        rest->l[r] = qp->l[r] - known, rest->u[r] = qp->u[r] - known;
    }
    for (int64_t e = 0, r = qp->m; e < count; e++) {
        const int64_t c = f->column[e];
        if (!is_bounded(qp, c)) continue;
        double *to = rest->C + r * n;
        memset(to, 0, n * sizeof *to);
        if (e >= f->loops)
            memcpy(to, f->force + (e - f->loops) * n, n * sizeof *to);
        else
            for (int64_t j = 0; j < f->supports; j++) to[f->support[j]] = f->by[j * f->loops + e];
        rest->l[r] = qp->lower[c] - f->shift[e], rest->u[r++] = qp->upper[c] - f->shift[e];
    }
    gather(f, qp->lower, rest->lower);
    gather(f, qp->upper, rest->upper);
}

void fold(const wbc_qp *qp, const wbc_plan *plan, int64_t *usual, double *scratch, int64_t *order, folded *f) {
    choose_folded(qp, plan, usual, scratch, order, f);
    if (f->count == 0) return;
    fold_all(qp, plan, f);
    order[2] = f->supports;
}

WIDE void unfold_point(const wbc_qp *qp, const folded *f, double *gradient) {
    const int64_t n = f->rest.n, loops = f->loops;
    const double *x = f->rest.x;
    for (int64_t j = 0; j < n; j++) qp->x[f->kept[j]] = x[j];
    for (int64_t e = 0; e < loops; e++) {
        double sum = f->shift[e];
        for (int64_t j = 0; j < f->supports; j++) sum += f->by[j * loops + e] * x[f->support[j]];
        qp->x[f->column[e]] = sum;
    }
    for (int64_t e = loops; e < f->count; e++)
        qp->x[f->column[e]] = f->shift[e] + dot(n, f->force + (e - loops) * n, x);
    memcpy(f->gradient, qp->g, qp->n * sizeof *gradient);
    add_slope(qp, qp->x, f->gradient);
    fold_row(f, f->gradient, f->count, f->scratch, gradient);
}

/* y of what was taken out: from the gradient, that P x + g + z_box + C'z + A'y is 0 there. */
INLINE void unfold_equalities(const wbc_qp *qp, const folded *f) {
    const int64_t n = qp->n, loops = f->loops;
    double *rest = f->scratch, *sum = rest + loops, *y = qp->y;
    for (int64_t r = 0; r < f->rest.k; r++) y[f->others[r]] = f->rest.y[r];
    for (int64_t part = 1; part >= 0; part--) { /* forces before velocities */
        const int64_t *column = f->column + part * loops, *row = f->row + part * loops;
        for (int64_t e = 0; e < loops; e++) rest[e] = f->gradient[column[e]];
        add_rows(loops, f->rest.k, f->rest.y, f->entry + part * loops, f->count, rest);
        for (int64_t r = loops; part == 0 && r < f->count; r++) {
            const double *A = qp->A + f->row[r] * n, by = y[f->row[r]];
            for (int64_t e = 0; e < loops; e++) rest[e] += by * A[column[e]];
        }
        memset(sum, 0, loops * sizeof *sum);
        if (part) /* N rest, else N' rest */
            for (int64_t i = 0; i < loops; i++) sum[i] = -dot(loops, f->inverse + i * loops, rest);
        else
            add_rows(loops, loops, rest, f->inverse, loops, sum);
        for (int64_t i = 0; i < loops; i++) y[row[i]] = -sum[i];
    }
}

WIDE void unfold(const wbc_qp *qp, const folded *f) {
    const int64_t n = qp->n;
    double *restrict gradient = f->gradient, *z = qp->z_box;
    for (int64_t j = 0; j < f->rest.n; j++) z[f->kept[j]] = f->rest.z_box[j];
    for (int64_t e = 0, r = qp->m; e < f->count; e++)
        z[f->column[e]] = is_bounded(qp, f->column[e]) ? f->rest.z[r++] : 0.0;
    memcpy(qp->z, f->rest.z, qp->m * sizeof *z);
    for (int64_t i = 0; i < n; i++) gradient[i] += z[i];
    add_rows(n, qp->m, qp->z, qp->C, n, gradient);
    unfold_equalities(qp, f);
}
