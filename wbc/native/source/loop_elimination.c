/* Elimination of what closed loops and gears determine, before the other equalities.
 *
 * A loop's rows involve few unknowns, those of its own joints. With the small inverse N = A_e^-1 they become
 * x_e = T x + t; at the torque level x_e are joints without a motor. The loop's forces f enter the dynamics of
 * these joints by exactly -A_e', and no other equality: N' eliminates them. What remains is the QP of a robot
 * without loops, of that size.
 */
#include "loop_elimination.h"
#include "linear.h"
#include "problem.h"

#include <string.h>

/* Copy run by run. Four at a time, written out: compilers turn a loop into a call, which takes longer than a run. */
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

INLINE void gather(const loop_elimination *f, const double *row, double *to) { gather_runs(f->run, row, to); }

/* Of the first entries only, which no run crosses: velocities, or all. */
INLINE void gather_wide(const loop_elimination *f, const double *row, int64_t wide, double *to) {
    for (const int64_t *run = f->run; run[1] > 0 && run[0] < wide; run += 2) {
        memcpy(to, row + run[0], run[1] * sizeof *to);
        to += run[1];
    }
}

/* A friction cone: entries of contact forces only. */
INLINE void gather_cone(const wbc_plan *plan, const loop_elimination *f, const double *row, double *to) {
    const int64_t *run = f->run;
    int64_t before = 0;
    for (; run[1] > 0 && run[0] < plan->tree->nv; run += 2) before += run[1];
    memset(to, 0, before * sizeof *to);
    gather_runs(run, row, to + before);
}

INLINE int is_cone(const wbc_plan *plan, int64_t r) { return r >= plan->bounded && r < plan->bounded + plan->cones; }

/* Write the entries of the eliminated unknowns in a row; returns whether any is not 0, by their bits, which is
 * faster. */
INLINE int eliminated_entries(const loop_elimination *f, const double *row, int64_t count, double *restrict entry) {
    const int64_t loops = f->loops;
    uint64_t any = 0, bits;
    for (int64_t e = 0; e < loops; e++) entry[e] = row[f->column[e]];
    if (count > loops) memcpy(entry + loops, row + f->column[loops], (count - loops) * sizeof *entry);
    for (int64_t e = 0; e < count; e++) {
        memcpy(&bits, entry + e, sizeof bits);
        any |= bits << 1; /* without the sign */
    }
    return any != 0;
}

/* Write a row in the remaining unknowns, and the entries of the eliminated ones (the first count). Returns the
 * constant that the offset adds. */
INLINE double substitute_in_row(const loop_elimination *f, const double *row, int64_t count, double *entry,
                                double *restrict to) {
    const int64_t loops = f->loops, n = f->remaining.n;
    gather(f, row, to);
    if (!eliminated_entries(f, row, count, entry)) return 0.0;
    for (int64_t j = 0; j < f->supports; j++) to[f->support[j]] += dot(loops, entry, f->velocity_map + j * loops);
    if (count > loops) add_rows(n, loops, entry + loops, f->force_map, n, to);
    return dot(count, entry, f->offset);
}

/* The velocities' map T = -N A, of columns that are not 0. */
INLINE void solve_for_velocities(const wbc_qp *qp, int64_t nv, loop_elimination *f) {
    const int64_t loops = f->loops;
    double *sum = f->scratch, *column = sum + nv;
    memset(sum, 0, nv * sizeof *sum);
    for (int64_t i = 0; i < loops; i++)
        for (int64_t c = 0; c < nv; c++) sum[c] += fabs(qp->A[f->row[i] * qp->n + c]);
    f->supports = 0;
    for (int64_t j = 0; j < f->remaining.n && f->columns_left[j] < nv; j++) {
        if (sum[f->columns_left[j]] == 0.0) continue;
        for (int64_t i = 0; i < loops; i++) column[i] = qp->A[f->row[i] * qp->n + f->columns_left[j]];
        for (int64_t e = 0; e < loops; e++)
            f->velocity_map[f->supports * loops + e] = -dot(loops, f->inverse + e * loops, column);
        f->support[f->supports++] = j;
    }
}

/* The velocities' offset N b; the forces' map N' D, with D the dynamics of the joints that they move, and offset. */
INLINE void solve_for_forces(const wbc_qp *qp, const loop_elimination *f) {
    const int64_t n = f->remaining.n, loops = f->loops;
    double *factor = f->scratch, *end = factor + loops, *dynamics = end + loops, *shift = f->offset;
    for (int64_t e = 0; e < loops; e++) end[e] = qp->b[f->row[e]];
    for (int64_t e = 0; e < loops; e++) shift[e] = dot(loops, f->inverse + e * loops, end);
    for (int64_t e = 0; e < loops; e++) {
        const int64_t r = f->row[loops + e];
        end[e] = substitute_in_row(f, qp->A + r * qp->n, loops, factor, dynamics + e * n) - qp->b[r];
    }
    memset(f->force_map, 0, loops * n * sizeof *f->force_map);
    for (int64_t i = 0; i < loops; i++) {
        for (int64_t e = 0; e < loops; e++) factor[e] = f->inverse[e * loops + i];
        add_rows(n, loops, factor, dynamics, n, f->force_map + i * n);
        shift[loops + i] = dot(loops, factor, end);
    }
}

/* The velocities' part of P: congruent transformation by their map. */
INLINE void substitute_in_velocity_cost(const wbc_qp *qp, const loop_elimination *f) {
    const int64_t n = f->remaining.n, loops = f->loops;
    double *P = f->remaining.P, *all = f->scratch, *own = all + qp->n;
    memset(P, 0, n * n * sizeof *P);
    for (int64_t i = 0; i < n; i++)
        if (f->columns_left[i] < qp->wide) gather_wide(f, qp->P + f->columns_left[i] * qp->n, qp->wide, P + i * n);
        else P[i * (n + 1)] = qp->P[f->columns_left[i] * (qp->n + 1)];
    for (int64_t j = 0; j < f->supports; j++) {
        const double *by = f->velocity_map + j * loops;
        const int64_t at = f->support[j];
        memset(all, 0, qp->n * sizeof *all);
        add_numbered(qp->wide, qp->n, loops, by, f->column, qp->P, 0, all);
        gather(f, all, own);
        INDEPENDENT
        for (int64_t i = 0; i < n; i++) P[at * n + i] += own[i];
        for (int64_t i = 0; i < n; i++) P[i * n + at] += own[i];
        eliminated_entries(f, all, loops, own);
        for (int64_t i = 0; i < f->supports; i++)
            P[at * n + f->support[i]] += dot(loops, own, f->velocity_map + i * loops);
    }
}

INLINE int has_same_pattern(int64_t n, const double *one, const double *other) {
    int64_t differs = 0;
    for (int64_t j = 0; j < n; j++) differs += (one[j] != 0.0) != (other[j] != 0.0);
    return differs == 0;
}

/* The forces' part of P, which is diagonal: a sum of squares of the rows of their map, of equal patterns together. */
INLINE void substitute_in_force_cost(const wbc_qp *qp, const loop_elimination *f) {
    const int64_t n = f->remaining.n, loops = f->loops;
    double *P = f->remaining.P, *none = f->scratch, *weighted = none + loops + n;
    int64_t *on = f->order;
    memset(none, 0, (loops + n) * sizeof *none); /* targets, and a gradient that is not used */
    for (int64_t begin = 0, end = 0; begin < loops; begin = end) {
        const double *first = f->force_map + begin * n;
        int64_t many = 0;
        for (int64_t j = 0; j < n; j++)
            if (first[j] != 0.0) on[many++] = j;
        double *square_of = weighted + loops * many;
        for (; end < loops && has_same_pattern(n, first, f->force_map + end * n); end++) {
            const double root = sqrt(qp->P[f->column[loops + end] * (qp->n + 1)]), *force = f->force_map + end * n;
            for (int64_t j = 0; j < many; j++) weighted[(end - begin) * many + j] = root * force[on[j]];
        }
        memset(square_of, 0, many * many * sizeof *none);
        add_squares(many, end - begin, weighted, none, square_of, many, none + loops);
        for (int64_t i = 0; i < many; i++) {
            P[on[i] * (n + 1)] += square_of[i * (many + 1)];
            for (int64_t j = i + 1; j < many; j++) {
                P[on[i] * n + on[j]] += square_of[i * many + j];
                P[on[j] * n + on[i]] += square_of[i * many + j];
            }
        }
    }
}

/* The gradient at remaining x = 0, in the remaining unknowns. */
INLINE void substitute_in_gradient(const wbc_qp *qp, const loop_elimination *f) {
    const int64_t n = qp->n, loops = f->loops, count = f->count;
    double *gradient = f->gradient;
    memcpy(gradient, qp->g, n * sizeof *gradient);
    add_numbered(qp->wide, n, loops, f->offset, f->column, qp->P, 0, gradient);
    for (int64_t e = loops; e < count; e++) gradient[f->column[e]] += f->offset[e] * qp->P[f->column[e] * (n + 1)];
    substitute_in_row(f, gradient, count, f->scratch, f->remaining.g);
}

WIDE static void substitute(const wbc_qp *qp, const wbc_plan *plan, loop_elimination *f) {
    const wbc_qp *rest = &f->remaining;
    const int64_t n = rest->n, count = f->count;
    solve_for_velocities(qp, plan->tree->nv, f);
    solve_for_forces(qp, f);
    substitute_in_velocity_cost(qp, f);
    substitute_in_force_cost(qp, f);
    substitute_in_gradient(qp, f);
    for (int64_t r = 0; r < rest->k; r++) {
        const int64_t from = f->rows_left[r];
        rest->b[r] =
            qp->b[from] - substitute_in_row(f, qp->A + from * qp->n, count, f->entry + r * count, rest->A + r * n);
    }
    for (int64_t r = 0; r < qp->m; r++) {
        double known = 0.0, *to = rest->C + r * n;
        if (is_cone(plan, r)) gather_cone(plan, f, qp->C + r * qp->n, to);
        else known = substitute_in_row(f, qp->C + r * qp->n, count, f->scratch, to);
        rest->l[r] = qp->l[r] - known, rest->u[r] = qp->u[r] - known;
    }
    for (int64_t e = 0, r = qp->m; e < count; e++) {
        const int64_t c = f->column[e];
        if (!is_bounded(qp, c)) continue;
        double *to = rest->C + r * n;
        memset(to, 0, n * sizeof *to);
        if (e >= f->loops) memcpy(to, f->force_map + (e - f->loops) * n, n * sizeof *to);
        else
            for (int64_t j = 0; j < f->supports; j++) to[f->support[j]] = f->velocity_map[j * f->loops + e];
        rest->l[r] = qp->lower[c] - f->offset[e], rest->u[r++] = qp->upper[c] - f->offset[e];
    }
    gather(f, qp->lower, rest->lower);
    gather(f, qp->upper, rest->upper);
}

void eliminate_loops(const wbc_qp *qp, const wbc_plan *plan, int64_t *last_pivots, double *scratch, int64_t *order,
                     loop_elimination *f) {
    choose_loop_pivots(qp, plan, last_pivots, scratch, order, f);
    if (f->count == 0) return;
    substitute(qp, plan, f);
    order[2] = f->supports;
}

WIDE void lift_loop_point(const wbc_qp *qp, const loop_elimination *f, double *gradient) {
    const int64_t n = f->remaining.n, loops = f->loops;
    const double *x = f->remaining.x;
    for (int64_t j = 0; j < n; j++) qp->x[f->columns_left[j]] = x[j];
    for (int64_t e = 0; e < loops; e++) {
        double sum = f->offset[e];
        for (int64_t j = 0; j < f->supports; j++) sum += f->velocity_map[j * loops + e] * x[f->support[j]];
        qp->x[f->column[e]] = sum;
    }
    for (int64_t e = loops; e < f->count; e++)
        qp->x[f->column[e]] = f->offset[e] + dot(n, f->force_map + (e - loops) * n, x);
    memcpy(f->gradient, qp->g, qp->n * sizeof *gradient);
    add_slope(qp, qp->x, f->gradient);
    substitute_in_row(f, f->gradient, f->count, f->scratch, gradient);
}

/* y of the eliminating equalities: P x + g + z_box + C'z + A'y = 0 in the eliminated unknowns. */
INLINE void lift_loop_equalities(const wbc_qp *qp, const loop_elimination *f) {
    const int64_t n = qp->n, loops = f->loops;
    double *rest = f->scratch, *sum = rest + loops, *y = qp->y;
    for (int64_t r = 0; r < f->remaining.k; r++) y[f->rows_left[r]] = f->remaining.y[r];
    for (int64_t part = 1; part >= 0; part--) { /* forces before velocities */
        const int64_t *column = f->column + part * loops, *row = f->row + part * loops;
        for (int64_t e = 0; e < loops; e++) rest[e] = f->gradient[column[e]];
        add_rows(loops, f->remaining.k, f->remaining.y, f->entry + part * loops, f->count, rest);
        for (int64_t r = loops; part == 0 && r < f->count; r++) {
            const double *A = qp->A + f->row[r] * n, by = y[f->row[r]];
            for (int64_t e = 0; e < loops; e++) rest[e] += by * A[column[e]];
        }
        memset(sum, 0, loops * sizeof *sum);
        if (part) /* N or N' times */
            for (int64_t i = 0; i < loops; i++) sum[i] = -dot(loops, f->inverse + i * loops, rest);
        else add_rows(loops, loops, rest, f->inverse, loops, sum);
        for (int64_t i = 0; i < loops; i++) y[row[i]] = -sum[i];
    }
}

WIDE void lift_loop_multipliers(const wbc_qp *qp, const loop_elimination *f) {
    const int64_t n = qp->n;
    double *restrict gradient = f->gradient, *z = qp->z_box;
    for (int64_t j = 0; j < f->remaining.n; j++) z[f->columns_left[j]] = f->remaining.z_box[j];
    for (int64_t e = 0, r = qp->m; e < f->count; e++)
        z[f->column[e]] = is_bounded(qp, f->column[e]) ? f->remaining.z[r++] : 0.0;
    memcpy(qp->z, f->remaining.z, qp->m * sizeof *z);
    for (int64_t i = 0; i < n; i++) gradient[i] += z[i];
    add_rows(n, qp->m, qp->z, qp->C, n, gradient);
    lift_loop_equalities(qp, f);
}
