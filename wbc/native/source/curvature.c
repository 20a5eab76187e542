/* How the CRB inertia curves: what an inertia task's Gauss-Newton step leaves out of the Hessian. */
#include <string.h>

#include "rows.h"

/* Of a column of v: how the inertia pulls at it, and how it moves; one by the other, six by six. */
enum { AXIAL = 0, PULLED = 3, ANGULAR = 6, LINEAR_PART = 9, COLUMN = 12 };

/* The second derivative (nv, nv) of <G, I> by v, world axes: inertia_hessian in
 * wbc/robot/inertia.py. columns holds 12 numbers a column. */
static void second_derivative(const wbc_tree *tree, const double *state, double mass,
                              const double *G, double *columns, double *H) {
    const int64_t nv = tree->nv;
    const double *rates = state + INERTIA_JACOBIAN(nv), *h = state + COM_JACOBIAN(nv);
    const double *T = state + TWISTS(nv), *com = state + COM, trace = G[0] + G[3] + G[5];
    const double K[9] = {trace - G[0], -G[1], -G[2], -G[1],       trace - G[3],
                         -G[4],        -G[2], -G[4], trace - G[5]};
    for (int64_t c = 0; c < nv; c++) {
        double *column = columns + COLUMN * c, *angular = column + ANGULAR, A[9], arm[3];
        const double dI[9] = {rates[c],          rates[nv + c],     rates[2 * nv + c],
                              rates[nv + c],     rates[3 * nv + c], rates[4 * nv + c],
                              rates[2 * nv + c], rates[4 * nv + c], rates[5 * nv + c]};
        const double moved[3] = {mass * h[c], mass * h[nv + c], mass * h[2 * nv + c]};
        for (int i = 0; i < 3; i++) angular[i] = T[(3 + i) * nv + c];
        product3(dI, K, A);
        column[AXIAL] = A[7] - A[5], column[AXIAL + 1] = A[2] - A[6];
        column[AXIAL + 2] = A[3] - A[1];
        times3(K, moved, column + PULLED);
        cross3(angular, com, arm);
        for (int i = 0; i < 3; i++) column[LINEAR_PART + i] = T[i * nv + c] + arm[i];
    }
    for (int64_t b = 0; b < nv; b++) {
        const double *pulled = columns + COLUMN * b + PULLED;
        const double x = -2.0 * pulled[0], y = -2.0 * pulled[1], z = -2.0 * pulled[2];
        for (int64_t a = 0; a < nv; a++)
            H[b * nv + a] = x * h[a] + y * h[nv + a] + z * h[2 * nv + a];
    }
    for (int64_t j = 1; j < tree->joints; j++)
        for (int64_t i = j; i > 0; i = tree->parent[i]) /* joints that carry this one, and itself */
            for (int64_t b = tree->iv[j]; b < tree->iv[j] + (j == 1 ? 6 : 1); b++)
                for (int64_t a = tree->iv[i]; a < tree->iv[i] + (i == 1 ? 6 : 1); a++) {
                    const double *pull = columns + COLUMN * b, *motion = columns + COLUMN * a + ANGULAR;
                    const double part = dot3(pull, motion) + dot3(pull + 3, motion + 3);
                    const double change = i == j ? part : 2.0 * part;
                    H[a * nv + b] += change;
                    H[b * nv + a] += change;
                }
}

void damp_by_curvature(const wbc_plan *plan, const wbc_block *block, const double *state,
                       const double *frames, const double *e, double factor, double *work,
                       double *P, int64_t n) {
    const int64_t nv = plan->tree->nv, k = block->rows, first = block->frame < 0 ? 0 : 6;
    const double *weight = plan->number + block->number + WEIGHTS, *own = weight + 3 * k;
    double pull[6] = {0.0}, G[6], *H = work + COLUMN * nv;
    for (int64_t i = 0; i < k; i++)
        for (int j = 0; j < 6; j++) pull[j] += weight[i] * weight[i] * e[i] * own[6 * i + j];
    pull[1] *= 0.5, pull[2] *= 0.5, pull[4] *= 0.5; /* these entries stand twice in the matrix */
    if (block->frame < 0)
        memcpy(G, pull, sizeof G);
    else
        congruent(frames + block->frame * FRAME_SIZE(nv) + FRAME_ROTATION, pull, G);
    second_derivative(plan->tree, state, plan->mass, G, work, H);
    double *sum = work; /* of columns: H is symmetric, and no sum waits for itself */
    memset(sum, 0, nv * sizeof *sum);
    for (int64_t a = first; a < nv; a++)
        for (int64_t b = first; b < nv; b++) sum[b] += fabs(H[a * nv + b]);
    for (int64_t a = first; a < nv; a++) P[a * n + a] += factor * sum[a];
}
