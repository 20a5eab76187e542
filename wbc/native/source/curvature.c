/* Second derivatives of the CRB inertia: the term that an inertia task's Gauss-Newton step neglects.
 *
 * With I = tr(S) 1 - S: a column i of v whose subtree contains that of column j moves the rate P_j of the
 * pseudo-inertia, with second and first moments S_j and h_j about the CoM, by [W_i] P_j + (..)', hence
 *
 *     d2S / (dv_i dv_j) = [w_i] S_j + u_i h_j' - h_i h_j' / M + (..)'
 *
 * The last term is the CoM's own motion, the only one if neither subtree contains the other. Rotations of the
 * base do not commute: the mean of both orders is taken.
 */
#include <string.h>

#include "rows.h"
#include "tree.h"

/* Four columns of v side by side: gradient by angular and linear motion, velocity at the CoM, and velocity of the
 * CoM. Columns beyond the last are 0. */
typedef struct {
    four angular[3], linear[3], at_com[3], com[3];
} columns;

/* Write the columns of v, for the gradient G by the inertia. Returns what lies behind them in work. */
INLINE double *weighted_columns(int64_t nv, const double *state, double mass, const double *G, columns *restrict to) {
    const double *restrict rates = state + INERTIA_JACOBIAN(nv), *h = state + COM_JACOBIAN(nv);
    const double *restrict T = state + TWISTS(nv), *com = state + COM;
    const double trace = G[0] + G[3] + G[5];
    const double k[6] = {mass * (trace - G[0]), -mass * G[1], -mass * G[2],
                         mass * (trace - G[3]), -mass * G[4], mass * (trace - G[5])};
    for (int64_t c = 0; c < nv; c += 4, to++) {
        const four xx = FOUR(rates + c), xy = FOUR(rates + nv + c), xz = FOUR(rates + 2 * nv + c);
        const four yy = FOUR(rates + 3 * nv + c), yz = FOUR(rates + 4 * nv + c), zz = FOUR(rates + 5 * nv + c);
        const four x = FOUR(h + c), y = FOUR(h + nv + c), z = FOUR(h + 2 * nv + c);
        const four p = FOUR(T + 3 * nv + c), q = FOUR(T + 4 * nv + c), r = FOUR(T + 5 * nv + c);
        /* the axis of G dI - dI G */
        to->angular[0] = (G[2] * xy + G[4] * yy + G[5] * yz) - (G[1] * xz + G[3] * yz + G[4] * zz);
        to->angular[1] = (G[0] * xz + G[1] * yz + G[2] * zz) - (G[2] * xx + G[4] * xy + G[5] * xz);
        to->angular[2] = (G[1] * xx + G[3] * xy + G[4] * xz) - (G[0] * xy + G[1] * yy + G[2] * yz);
        to->linear[0] = k[0] * x + k[1] * y + k[2] * z;
        to->linear[1] = k[1] * x + k[3] * y + k[4] * z;
        to->linear[2] = k[2] * x + k[4] * y + k[5] * z;
        to->at_com[0] = FOUR(T + c) + (q * com[2] - r * com[1]);
        to->at_com[1] = FOUR(T + nv + c) + (r * com[0] - p * com[2]);
        to->at_com[2] = FOUR(T + 2 * nv + c) + (p * com[1] - q * com[0]);
        to->com[0] = x, to->com[1] = y, to->com[2] = z;
    }
    for (int64_t j = nv & 3; j && j < 4; j++)
        for (int i = 0; i < 3; i++)
            to[-1].angular[i][j] = to[-1].linear[i][j] = to[-1].at_com[i][j] = to[-1].com[i][j] = 0.0;
    return (double *)to;
}

/* The joint behind the subtree of joint i, which is contiguous. */
static int64_t subtree_end(const wbc_tree *tree, int64_t i) {
    int64_t j = i + 1;
    while (j < tree->joints && tree->parent[j] >= i) j++;
    return j;
}

/* The second derivative by column b, which column a moves as a whole. */
INLINE double moved_by(int64_t nv, const double *turn, const columns *of, int64_t a, int64_t b) {
    const columns *one = of + (a >> 2), *other = of + (b >> 2);
    double sum = 0.0;
    for (int r = 0; r < 3; r++)
        sum += turn[r * nv + a] * other->angular[r][b & 3] + one->at_com[r][a & 3] * other->linear[r][b & 3];
    return sum;
}

/* Row a of the second derivative (nv, nv) of <G, I> by v, world axes, from the diagonal on, zeros before. turn: the
 * columns' angular velocities; end: the column behind a's subtree. In aligned blocks of four, so that no load waits
 * for a store of another width. */
INLINE void second_derivative_row(int64_t nv, const double *turn, const columns *of, int64_t a, int64_t end,
                                  double *restrict row) {
    static const double from[4][4] = {{1, 1, 1, 1}, {0, 1, 1, 1}, {0, 0, 1, 1}, {0, 0, 0, 1}}; /* lanes from the
                                                                                                * diagonal on */
    const columns *at = of + (a >> 2);
    const int64_t begin = a & ~(int64_t)3, lane = a & 3;
    double by[3], turned[3], moved[3];
    for (int i = 0; i < 3; i++) {
        by[i] = -2.0 * at->linear[i][lane];
        turned[i] = 2.0 * turn[i * nv + a], moved[i] = 2.0 * at->at_com[i][lane];
    }
    for (int64_t b = begin; b < nv; b += 4, at++) {
        four now = by[0] * at->com[0] + by[1] * at->com[1] + by[2] * at->com[2];
        if (b < end) {
            four carried = (turned[0] * at->angular[0] + turned[1] * at->angular[1] + turned[2] * at->angular[2]) +
                           (moved[0] * at->linear[0] + moved[1] * at->linear[1] + moved[2] * at->linear[2]);
            if (b + 4 > end) carried *= 1.0 - FOUR(from[end & 3]);
            now += carried;
        }
        *(four *)(row + b) = now;
    }
    for (int64_t b = a; b < 6; b++) /* the base's columns move each other */
        row[b] += moved_by(nv, turn, of, b, a) - moved_by(nv, turn, of, a, b);
    *(four *)(row + begin) *= FOUR(from[lane]);
}

/* Add the absolute values of a row, and of its mirror image below the diagonal, to the sums of the rows. */
INLINE void add_sizes(int64_t nv, int64_t a, const double *restrict row, double *restrict sum) {
    double own[4] = {0.0};
    for (int64_t b = a & ~(int64_t)3; b < PADDED(nv); b += 4)
        for (int j = 0; j < 4; j++) {
            const double size = fabs(row[b + j]);
            sum[b + j] += size, own[j] += size;
        }
    sum[a] += (own[0] + own[2]) + (own[1] + own[3]) - fabs(row[a]);
}

/* The gradient of the cost by the inertia, a symmetric matrix G in world axes, and the columns of v for it. Returns
 * what lies behind them in work. */
INLINE double *gradient_columns(const wbc_plan *plan, const wbc_block *block, const double *state,
                                const double *frames, const double *e, double *work) {
    const int64_t nv = plan->tree->nv, k = block->rows;
    const double *weight = plan->number + block->number + WEIGHTS, *own = weight + 3 * k;
    double pull[6] = {0.0}, G[6];
    for (int64_t i = 0; i < k; i++)
        for (int j = 0; j < 6; j++) pull[j] += weight[i] * weight[i] * e[i] * own[6 * i + j];
    pull[1] *= 0.5, pull[2] *= 0.5, pull[4] *= 0.5; /* off-diagonal entries stand twice in G */
    if (block->frame < 0) memcpy(G, pull, sizeof G);
    else congruent(frames + block->frame * FRAME_SIZE(nv) + FRAME_ROTATION, pull, G);
    return weighted_columns(nv, state, plan->mass, G, (columns *)work);
}

/* The first column that counts: in axes of the base, the base's own columns do not. */
static int64_t first_column(const wbc_block *block) { return block->frame < 0 ? 0 : 6; }

/* The columns of joint j, and the one behind its subtree. */
INLINE void joint_columns(const wbc_tree *tree, int64_t j, int64_t *begin, int64_t *behind, int64_t *end) {
    const int64_t last = subtree_end(tree, j) - 1;
    *end = last < 2 ? 6 : tree->iv[last] + 1;
    *behind = columns_of(tree, j, begin);
}

WIDE void damp_by_curvature(const wbc_plan *plan, const wbc_block *block, const double *state, const double *frames,
                            const double *e, double factor, double *work, double *to, int64_t stride) {
    const wbc_tree *tree = plan->tree;
    const int64_t nv = tree->nv, first = first_column(block);
    const double *turn = state + TWISTS(nv) + 3 * nv;
    double *row = gradient_columns(plan, block, state, frames, e, work), *sum = row + PADDED(nv);
    int64_t begin, behind, end;
    memset(sum, 0, PADDED(nv) * sizeof *sum);
    for (int64_t j = first ? 2 : 1; j < tree->joints; j++) {
        joint_columns(tree, j, &begin, &behind, &end);
        for (int64_t a = begin; a < behind; a++) {
            second_derivative_row(nv, turn, (const columns *)work, a, end, row);
            add_sizes(nv, a, row, sum);
        }
    }
    for (int64_t a = first; a < nv; a++) to[a * stride] += factor * sum[a];
}

/* Add the second derivative, from the first column on. */
INLINE void add_hessian(const wbc_tree *tree, const double *state, int64_t first, const double *work, double *row,
                        double *H) {
    const int64_t nv = tree->nv;
    const double *turn = state + TWISTS(nv) + 3 * nv;
    int64_t begin, behind, end;
    for (int64_t j = first ? 2 : 1; j < tree->joints; j++) {
        joint_columns(tree, j, &begin, &behind, &end);
        for (int64_t a = begin; a < behind; a++) {
            second_derivative_row(nv, turn, (const columns *)work, a, end, row);
            H[a * nv + a] += row[a];
            for (int64_t b = a + 1; b < nv; b++) H[a * nv + b] += row[b], H[b * nv + a] += row[b];
        }
    }
}

WIDE void add_curvature(const wbc_plan *plan, const wbc_block *block, const double *state, const double *frames,
                        const double *e, double *work, double *H) {
    double *row = gradient_columns(plan, block, state, frames, e, work);
    add_hessian(plan->tree, state, first_column(block), work, row, H);
}

WIDE int wbc_inertia_hessian(const wbc_tree *tree, const double *state, double mass, const double *G, double *work,
                             double *H) {
    memset(H, 0, tree->nv * tree->nv * sizeof *H);
    double *row = weighted_columns(tree->nv, state, mass, G, (columns *)work);
    add_hessian(tree, state, 0, work, row, H);
    return DONE;
}
