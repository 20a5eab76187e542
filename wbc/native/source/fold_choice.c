/* Which unknowns and equalities closed loops determine; what is done with them: fold.c. */
#include "fold.h"
#include "linear.h"
#include "problem.h"
#include "reduce.h"

#include <string.h>

static const double LARGEST = 1e4; /* entries of N [1/m]: near dead centres others are to be eliminated */

static int is_mechanics(const wbc_block *block) {
    return block->held && (block->kind == LOOP || block->kind == GEAR);
}

int64_t mechanics(const wbc_plan *plan, int64_t *first) {
    int64_t count = 0;
    for (const wbc_block *block = plan->block + plan->blocks; block-- > plan->block;)
        if (is_mechanics(block)) *first = block->first, count += block->rows;
    return count;
}

int64_t folded_numbers(int64_t n, int64_t k, int64_t m) {
    return n * n + 4 * k * n + m * n + 2 * k * k + 6 * n + 6 * k + 3 * m + 5;
}

int64_t folded_integers(int64_t n, int64_t k) { return 5 + 4 * n + 3 * k; }

/* Count, loops and supports stand in front; bounds of what was taken out are further rows C. */
void find_folded(const wbc_qp *qp, const wbc_plan *plan, double *scratch, int64_t *order, folded *f) {
    const int64_t n = qp->n, k = qp->k;
    f->rest = *qp, f->scratch = scratch, f->order = order, f->count = 0;
    if (!plan) return;
    f->count = order[0], f->loops = order[1], f->supports = order[2];
    f->column = order + 3, f->row = f->column + k, f->others = f->row + k, f->kept = f->others + k;
    f->support = f->kept + n, f->run = f->support + n, f->order = order + folded_integers(n, k);
    if (f->count == 0) return;
    wbc_qp *rest = &f->rest;
    rest->n -= f->count, rest->k -= f->count, rest->wide = rest->n;
    for (int64_t e = 0; e < f->count; e++) rest->m += is_bounded(qp, f->column[e]);
    double **parts[] = {&rest->P, &rest->A, &rest->C, &rest->g, &rest->lower, &rest->upper, &rest->b,
                        &rest->l, &rest->u, &rest->x, &rest->y, &rest->z, &rest->z_box, &rest->found,
                        &f->by, &f->force, &f->shift, &f->inverse, &f->gradient, &f->entry};
    const int64_t most = qp->m + f->count;
    const int64_t size[] = {rest->n * rest->n, rest->k * rest->n, most * rest->n, rest->n, rest->n,
                            rest->n, rest->k, most, most, rest->n, rest->k, most, rest->n, 5,
                            f->loops * rest->n, f->loops * rest->n, f->count, f->loops * f->loops, n,
                            rest->k * f->count};
    for (int i = 0; i < 20; i++) *parts[i] = f->scratch, f->scratch += size[i];
}

/* Which velocities go by the loops' rows, of joints without a motor, and by which inverse; false if they do not. */
static int invert_loops(const wbc_qp *qp, const wbc_plan *plan, int64_t begin, int64_t *usual, folded *f) {
    const int64_t loops = f->loops, passives = plan->passives;
    double *A = f->scratch + reduced_numbers(passives, loops, 0), *none = A + loops * passives, largest = 0.0;
    const wbc_qp own = {.n = passives, .k = loops, .A = A, .b = qp->b + begin, .y = qp->y, .lower = none,
                        .upper = none};
    reduced r;
    for (int64_t i = 0; i < loops; i++)
        for (int64_t p = 0; p < passives; p++)
            A[i * passives + p] = qp->A[(begin + i) * qp->n + plan->passive[p]];
    memset(none, 0, passives * sizeof *none); /* bounds: no joint is preferred to others */
    place(&own, f->scratch, f->order, &r);
    if (solve_equalities(&own, &r, usual, 0) < 0 || r.rank < loops) return 0;
    memcpy(f->inverse, r.inverse, loops * loops * sizeof *A);
    for (int64_t i = 0; i < loops; i++) {
        f->row[i] = begin + r.row[i];
        f->row[loops + i] = r.order[i]; /* its dynamics */
        f->column[i] = plan->passive[r.order[i]];
    }
    for (int64_t i = 0; i < loops * loops; i++)
        if (!(fabs(f->inverse[i]) < largest)) largest = fabs(f->inverse[i]);
    return largest < LARGEST;
}

/* The forces in the loops, which are behind each other in the order of their rows; false if there are others than
 * that, or costs that mix them. */
static int find_forces(const wbc_qp *qp, const wbc_plan *plan, folded *f) {
    const int64_t n = qp->n, loops = f->loops;
    int64_t *column = f->column + loops, found = 0;
    for (const wbc_force *force = plan->force; force < plan->force + plan->bearing; force++) {
        const wbc_block *block = plan->block + force->block;
        if (!is_mechanics(block) || force->count != block->rows) continue;
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

/* The unknowns that stay and the equalities that do. */
static void find_kept(const wbc_qp *qp, int64_t nv, folded *f) {
    int64_t *mark = f->order, *run = f->run, count = 0;
    memset(mark, 0, (qp->n > qp->k ? qp->n : qp->k) * sizeof *mark);
    for (int64_t e = 0; e < f->count; e++) mark[f->column[e]] = 1;
    for (int64_t c = 0; c < qp->n; c++)
        if (!mark[c]) {
            f->kept[count++] = c;
            if (c > 0 && c != nv && !mark[c - 1])
                run[-1]++;
            else
                run[0] = c, run[1] = 1, run += 2;
        }
    run[0] = run[1] = 0;
    memset(mark, 0, qp->k * sizeof *mark);
    for (int64_t e = 0; e < f->count; e++) mark[f->row[e]] = 1;
    count = 0;
    for (int64_t r = 0; r < qp->k; r++)
        if (!mark[r]) f->others[count++] = r;
}

void choose_folded(const wbc_qp *qp, const wbc_plan *plan, int64_t *usual, double *scratch, int64_t *order,
                   folded *f) {
    int64_t first = 0;
    if (plan) {
        const int64_t loops = mechanics(plan, &first);
        const int known = loops <= plan->passives && loops <= plan->forces;
        order[0] = known ? 2 * loops : 0, order[1] = loops, order[2] = 0;
        memset(order + 3, 0, qp->k * sizeof *order); /* columns that nobody knows yet */
    }
    find_folded(qp, plan, scratch, order, f);
    if (f->count == 0) return;
    if (!invert_loops(qp, plan, first + plan->passives, usual, f) || !find_forces(qp, plan, f)) order[0] = 0;
    find_folded(qp, plan, scratch, order, f);
    if (f->count > 0) find_kept(qp, plan->tree->nv, f);
}
