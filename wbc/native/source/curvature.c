/* How the CRB inertia curves: what an inertia task's Gauss-Newton step leaves out of the Hessian.
 *
 * With I = tr(S) 1 - S, a column i of v that carries all that column j does moves the rate P_j of the
 * pseudo-inertia, with S_j and h_j its second and first moments about the CoM, by [W_i] P_j + (..)', hence
 *
 *     d2S / (dv_i dv_j) = [w_i] S_j + u_i h_j' - h_i h_j' / M + (..)'
 *
 * of which the last term is the CoM's own motion; it alone is left where neither carries the other. Rotations
 * of the base do not commute: of both orders the mean is taken.
 */
#include <string.h>

#include "rows.h"

/* Rows of work, nv entries each and zeros up to a multiple of four: how the inertia pulls at a column
 * of v, angular and linear, and the column's velocity at the CoM. */
enum { ANGULAR_PULL = 0, LINEAR_PULL = 3, AT_COM = 6, ROWS = 9 };

/* Columns of v by how the inertia pulls at them, G, and how they move. */
INLINE void pulls(int64_t nv, const double *state, double mass, const double *G,
                  double *restrict work) {
    const double *restrict rates = state + INERTIA_JACOBIAN(nv), *h = state + COM_JACOBIAN(nv);
    const double *restrict T = state + TWISTS(nv), *com = state + COM;
    const int64_t w = PADDED(nv);
    const double trace = G[0] + G[3] + G[5];
    const double k[6] = {mass * (trace - G[0]), -mass * G[1],          -mass * G[2],
                         mass * (trace - G[3]), -mass * G[4], mass * (trace - G[5])};
    for (int r = 0; r < ROWS; r++)
        for (int64_t c = nv; c < w; c++) work[r * w + c] = 0.0;
    INDEPENDENT
    for (int64_t c = 0; c < nv; c++) {
        const double xx = rates[c], xy = rates[nv + c], xz = rates[2 * nv + c];
        const double yy = rates[3 * nv + c], yz = rates[4 * nv + c], zz = rates[5 * nv + c];
        const double x = h[c], y = h[nv + c], z = h[2 * nv + c];
        const double p = T[3 * nv + c], q = T[4 * nv + c], r = T[5 * nv + c];
        /* the axis of G dI - dI G */
        work[c] = (G[2] * xy + G[4] * yy + G[5] * yz) - (G[1] * xz + G[3] * yz + G[4] * zz);
        work[w + c] = (G[0] * xz + G[1] * yz + G[2] * zz) - (G[2] * xx + G[4] * xy + G[5] * xz);
        work[2 * w + c] = (G[1] * xx + G[3] * xy + G[4] * xz) - (G[0] * xy + G[1] * yy + G[2] * yz);
        work[3 * w + c] = k[0] * x + k[1] * y + k[2] * z;
        work[4 * w + c] = k[1] * x + k[3] * y + k[4] * z;
        work[5 * w + c] = k[2] * x + k[4] * y + k[5] * z;
        work[6 * w + c] = T[c] + (q * com[2] - r * com[1]);
        work[7 * w + c] = T[nv + c] + (r * com[0] - p * com[2]);
        work[8 * w + c] = T[2 * nv + c] + (p * com[1] - q * com[0]);
    }
}

/* The joint behind the last one that joint i carries: those that it carries follow it. */
static int64_t carried_until(const wbc_tree *tree, int64_t i) {
    int64_t j = i + 1;
    while (j < tree->joints && tree->parent[j] >= i) j++;
    return j;
}

/* How the inertia pulls at column b as column a moves all that b moves. */
INLINE double moved_by(int64_t nv, const double *turn, const double *work, int64_t a, int64_t b) {
    const int64_t w = PADDED(nv);
    const double *carried = work + LINEAR_PULL * w, *at_com = work + AT_COM * w;
    double sum = 0.0;
    for (int r = 0; r < 3; r++)
        sum += turn[r * nv + a] * work[r * w + b] + at_com[r * w + a] * carried[r * w + b];
    return sum;
}

/* Row a of the second derivative (nv, nv) of <G, I> by v, world axes, from its diagonal on, zeros
 * elsewhere. end: behind the columns that column a carries.
 * All loops begin at a multiple of four: what is stored as a vector is read back as the same one. */
INLINE void second_derivative_row(int64_t nv, const double *state, const double *work, int64_t a,
                                  int64_t end, double *restrict row) {
    const int64_t w = PADDED(nv), begin = a & ~(int64_t)3;
    const double *h = state + COM_JACOBIAN(nv), *turn = state + TWISTS(nv) + 3 * nv;
    const double *carried = work + LINEAR_PULL * w, *at_com = work + AT_COM * w;
    const double x = -2.0 * carried[a], y = -2.0 * carried[w + a], z = -2.0 * carried[2 * w + a];
    double by[6];
    for (int i = 0; i < 3; i++)
        by[i] = 2.0 * turn[i * nv + a], by[3 + i] = 2.0 * at_com[i * w + a];
    for (int64_t b = begin; b < w; b++) row[b] = x * h[b] + y * h[nv + b] + z * h[2 * nv + b];
    for (int64_t b = begin; b < end; b++)
        row[b] += (by[0] * work[b] + by[1] * work[w + b] + by[2] * work[2 * w + b]) +
                  (by[3] * carried[b] + by[4] * carried[w + b] + by[5] * carried[2 * w + b]);
    for (int64_t b = a; b < 6; b++) /* the base's columns carry each other */
        row[b] += moved_by(nv, turn, work, b, a) - moved_by(nv, turn, work, a, b);
    for (int64_t b = begin; b < a; b++) row[b] = 0.0;
    for (int64_t b = nv; b < w; b++) row[b] = 0.0;
}

/* Add what a row, and its mirror image below the diagonal, adds to the sums of absolute values. */
INLINE void add_sizes(int64_t nv, int64_t a, const double *restrict row, double *restrict sum) {
    double own[4] = {0.0};
    for (int64_t b = a & ~(int64_t)3; b < PADDED(nv); b += 4)
        for (int j = 0; j < 4; j++) {
            const double size = fabs(row[b + j]);
            sum[b + j] += size, own[j] += size;
        }
    sum[a] += (own[0] + own[2]) + (own[1] + own[3]) - fabs(row[a]);
}

/* The cost's slope by the inertia's entries, as a symmetric matrix G in the world's axes, and how columns
 * of v pull at it; row (padded nv) is behind them. Returns the first column that counts: of axes of the
 * base those of the base do not. */
INLINE int64_t prepare(const wbc_plan *plan, const wbc_block *block, const double *state,
                       const double *frames, const double *e, double *work) {
    const int64_t nv = plan->tree->nv, k = block->rows;
    const double *weight = plan->number + block->number + WEIGHTS, *own = weight + 3 * k;
    double pull[6] = {0.0}, G[6];
    for (int64_t i = 0; i < k; i++)
        for (int j = 0; j < 6; j++) pull[j] += weight[i] * weight[i] * e[i] * own[6 * i + j];
    pull[1] *= 0.5, pull[2] *= 0.5, pull[4] *= 0.5; /* these entries stand twice in the matrix */
    if (block->frame < 0)
        memcpy(G, pull, sizeof G);
    else
        congruent(frames + block->frame * FRAME_SIZE(nv) + FRAME_ROTATION, pull, G);
    pulls(nv, state, plan->mass, G, work);
    return block->frame < 0 ? 0 : 6;
}

/* Of joint j: its columns of v, and where those end that it carries. */
INLINE void columns_of(const wbc_tree *tree, int64_t j, int64_t *begin, int64_t *behind, int64_t *end) {
    const int64_t last = carried_until(tree, j) - 1;
    *end = last < 2 ? 6 : tree->iv[last] + 1;
    *begin = j == 1 ? 0 : tree->iv[j], *behind = j == 1 ? 6 : *begin + 1;
}

WIDE void damp_by_curvature(const wbc_plan *plan, const wbc_block *block, const double *state,
                            const double *frames, const double *e, double factor, double *work,
                            double *to, int64_t stride) {
    const wbc_tree *tree = plan->tree;
    const int64_t nv = tree->nv, first = prepare(plan, block, state, frames, e, work);
    double *row = work + ROWS * PADDED(nv), *sum = row + PADDED(nv);
    int64_t begin, behind, end;
    memset(sum, 0, PADDED(nv) * sizeof *sum);
    for (int64_t j = first ? 2 : 1; j < tree->joints; j++) {
        columns_of(tree, j, &begin, &behind, &end);
        for (int64_t a = begin; a < behind; a++) {
            second_derivative_row(nv, state, work, a, end, row);
            add_sizes(nv, a, row, sum);
        }
    }
    for (int64_t a = first; a < nv; a++) to[a * stride] += factor * sum[a];
}

/* Add the second derivative, by columns from the first that counts on. */
INLINE void add_hessian(const wbc_tree *tree, const double *state, int64_t first, double *work, double *H) {
    const int64_t nv = tree->nv;
    double *row = work + ROWS * PADDED(nv);
    int64_t begin, behind, end;
    for (int64_t j = first ? 2 : 1; j < tree->joints; j++) {
        columns_of(tree, j, &begin, &behind, &end);
        for (int64_t a = begin; a < behind; a++) {
            second_derivative_row(nv, state, work, a, end, row);
            H[a * nv + a] += row[a];
            for (int64_t b = a + 1; b < nv; b++) H[a * nv + b] += row[b], H[b * nv + a] += row[b];
        }
    }
}

WIDE void add_curvature(const wbc_plan *plan, const wbc_block *block, const double *state,
                        const double *frames, const double *e, double *work, double *H) {
    const int64_t first = prepare(plan, block, state, frames, e, work);
    add_hessian(plan->tree, state, first, work, H);
}

WIDE int wbc_inertia_hessian(const wbc_tree *tree, const double *state, double mass, const double *G,
                             double *work, double *H) {
    memset(H, 0, tree->nv * tree->nv * sizeof *H);
    pulls(tree->nv, state, mass, G, work);
    add_hessian(tree, state, 0, work, H);
    return DONE;
}
