/* The choice of the unknowns and equalities that closed loops determine; see loop_elimination.c. */
#include "loop_elimination.h"
#include "linear.h"
#include "problem.h"
#include "reduce.h"

#include <string.h>

static const double LARGEST = 1e4; /* largest entry of N [1/m]: near singular configurations other unknowns are
                                    * eliminated */

static int is_loop_or_gear(const wbc_block *block) {
    return block->held && (block->kind == LOOP || block->kind == GEAR);
}

int64_t loop_rows_held(const wbc_plan *plan, int64_t *first) {
    int64_t count = 0;
    for (const wbc_block *block = plan->block + plan->blocks; block-- > plan->block;)
        if (is_loop_or_gear(block)) *first = block->first, count += block->rows;
    return count;
}

int64_t loop_elimination_numbers(int64_t n, int64_t k, int64_t m) {
    return n * n + 4 * k * n + m * n + 2 * k * k + 6 * n + 6 * k + 3 * m + 5;
}

int64_t loop_elimination_integers(int64_t n, int64_t k) { return 5 + 4 * n + 3 * k; }

/* The first integers are count, loops and supports; finite bounds of eliminated unknowns are further rows of C. */
void restore_loop_elimination(const wbc_qp *qp, const wbc_plan *plan, double *scratch, int64_t *order,
                              loop_elimination *f) {
    const int64_t n = qp->n, k = qp->k;
    f->remaining = *qp, f->scratch = scratch, f->order = order, f->count = 0;
    if (!plan) return;
    f->count = order[0], f->loops = order[1], f->supports = order[2];
    f->column = order + 3, f->row = f->column + k, f->rows_left = f->row + k, f->columns_left = f->rows_left + k;
    f->support = f->columns_left + n, f->run = f->support + n, f->order = order + loop_elimination_integers(n, k);
    if (f->count == 0) return;
    wbc_qp *rest = &f->remaining;
    rest->n -= f->count, rest->k -= f->count, rest->wide = rest->n;
    for (int64_t e = 0; e < f->count; e++) rest->m += is_bounded(qp, f->column[e]);
    double **parts[] = {&rest->P,      &rest->A,   &rest->C,     &rest->g,     &rest->lower,
                        &rest->upper,  &rest->b,   &rest->l,     &rest->u,     &rest->x,
                        &rest->y,      &rest->z,   &rest->z_box, &rest->found, &f->velocity_map,
                        &f->force_map, &f->offset, &f->inverse,  &f->gradient, &f->entry};
    const int64_t most = qp->m + f->count;
    const int64_t size[] = {rest->n * rest->n,
                            rest->k * rest->n,
                            most * rest->n,
                            rest->n,
                            rest->n,
                            rest->n,
                            rest->k,
                            most,
                            most,
                            rest->n,
                            rest->k,
                            most,
                            rest->n,
                            5,
                            f->loops * rest->n,
                            f->loops * rest->n,
                            f->count,
                            f->loops * f->loops,
                            n,
                            rest->k * f->count};
    for (int i = 0; i < 20; i++) *parts[i] = f->scratch, f->scratch += size[i];
}

/* Choose velocities of joints without a motor, and invert the loops' rows in them; false if that fails. */
static int invert_loops(const wbc_qp *qp, const wbc_plan *plan, int64_t begin, int64_t *last_pivots,
                        loop_elimination *f) {
    const int64_t loops = f->loops, passives = plan->passives;
    double *A = f->scratch + reduced_numbers(passives, loops, 0), *none = A + loops * passives, largest = 0.0;
    const wbc_qp own = {
        .n = passives, .k = loops, .A = A, .b = qp->b + begin, .y = qp->y, .lower = none, .upper = none};
    reduced r;
    for (int64_t i = 0; i < loops; i++)
        for (int64_t p = 0; p < passives; p++) A[i * passives + p] = qp->A[(begin + i) * qp->n + plan->passive[p]];
    memset(none, 0, passives * sizeof *none); /* bounds: no joint is preferred */
    lay_out_reduced(&own, f->scratch, f->order, &r);
    if (solve_equalities(&own, &r, last_pivots, 0) < 0 || r.rank < loops) return 0;
    memcpy(f->inverse, r.inverse, loops * loops * sizeof *A);
    for (int64_t i = 0; i < loops; i++) {
        f->row[i] = begin + r.row[i];
        f->row[loops + i] = r.order[i]; /* the dynamics of this joint */
        f->column[i] = plan->passive[r.order[i]];
    }
    for (int64_t i = 0; i < loops * loops; i++)
        if (!(fabs(f->inverse[i]) < largest)) largest = fabs(f->inverse[i]);
    return largest < LARGEST;
}

/* Find the forces in the loops, in the order of their rows; false if there are others, or costs couple them. */
static int find_loop_forces(const wbc_qp *qp, const wbc_plan *plan, loop_elimination *f) {
    const int64_t n = qp->n, loops = f->loops;
    int64_t *column = f->column + loops, found = 0;
    for (const wbc_force *force = plan->force; force < plan->force + plan->bearing; force++) {
        const wbc_block *block = plan->block + force->block;
        if (!is_loop_or_gear(block) || force->count != block->rows) continue;
        const int64_t first = plan->passives + block->first;
        for (int64_t i = 0; i < loops; i++)
            if (f->row[i] >= first && f->row[i] < first + block->rows)
                column[i] = plan->tree->nv + force->column + f->row[i] - first, found++;
    }
    for (int64_t i = 0; i < loops && found == loops; i++) {
        const double *P = qp->P + column[i] * n, entry = P[column[i]];
        if (column[i] != column[0] + i) return 0;
        if (column[i] < qp->wide && dot(n, P, P) != entry * entry) return 0;
    }
    return found == loops;
}

/* List the unknowns and equalities that are left. */
static void find_remaining(const wbc_qp *qp, int64_t nv, loop_elimination *f) {
    int64_t *mark = f->order, *run = f->run, count = 0;
    memset(mark, 0, (qp->n > qp->k ? qp->n : qp->k) * sizeof *mark);
    for (int64_t e = 0; e < f->count; e++) mark[f->column[e]] = 1;
    for (int64_t c = 0; c < qp->n; c++)
        if (!mark[c]) {
            f->columns_left[count++] = c;
            if (c > 0 && c != nv && !mark[c - 1]) run[-1]++;
            else run[0] = c, run[1] = 1, run += 2;
        }
    run[0] = run[1] = 0;
    memset(mark, 0, qp->k * sizeof *mark);
    for (int64_t e = 0; e < f->count; e++) mark[f->row[e]] = 1;
    count = 0;
    for (int64_t r = 0; r < qp->k; r++)
        if (!mark[r]) f->rows_left[count++] = r;
}

void choose_loop_pivots(const wbc_qp *qp, const wbc_plan *plan, int64_t *last_pivots, double *scratch, int64_t *order,
                        loop_elimination *f) {
    int64_t first = 0;
    if (plan) {
        const int64_t loops = loop_rows_held(plan, &first);
        const int known = loops <= plan->passives && loops <= plan->forces;
        order[0] = known ? 2 * loops : 0, order[1] = loops, order[2] = 0;
        memset(order + 3, 0, qp->k * sizeof *order); /* no pivots are known */
    }
    restore_loop_elimination(qp, plan, scratch, order, f);
    if (f->count == 0) return;
    if (!invert_loops(qp, plan, first + plan->passives, last_pivots, f) || !find_loop_forces(qp, plan, f))
        order[0] = 0;
    restore_loop_elimination(qp, plan, scratch, order, f);
    if (f->count > 0) find_remaining(qp, plan->tree->nv, f);
}
