/* How the CRB inertia curves: what an inertia task's Gauss-Newton step leaves out of the Hessian. */
#include <string.h>

#include "rows.h"

/* Rows (nv) of work: how the inertia pulls at a column of v, angular and linear, and the column's
 * velocity at the CoM. */
enum { ANGULAR_PULL = 0, LINEAR_PULL = 3, AT_COM = 6, ROWS = 9 };

/* Columns of v by how the inertia pulls at them, G, and how they move. */
INLINE void pulls(int64_t nv, const double *state, double mass, const double *G,
                  double *restrict work) {
    const double *restrict rates = state + INERTIA_JACOBIAN(nv), *h = state + COM_JACOBIAN(nv);
    const double *restrict T = state + TWISTS(nv), *com = state + COM;
    const double trace = G[0] + G[3] + G[5];
    const double k[6] = {mass * (trace - G[0]), -mass * G[1],          -mass * G[2],
                         mass * (trace - G[3]), -mass * G[4], mass * (trace - G[5])};
    for (int64_t c = 0; c < nv; c++) {
        const double xx = rates[c], xy = rates[nv + c], xz = rates[2 * nv + c];
        const double yy = rates[3 * nv + c], yz = rates[4 * nv + c], zz = rates[5 * nv + c];
        const double x = h[c], y = h[nv + c], z = h[2 * nv + c];
        const double p = T[3 * nv + c], q = T[4 * nv + c], r = T[5 * nv + c];
        /* the axis of G dI - dI G */
        work[c] = (G[2] * xy + G[4] * yy + G[5] * yz) - (G[1] * xz + G[3] * yz + G[4] * zz);
        work[nv + c] = (G[0] * xz + G[1] * yz + G[2] * zz) - (G[2] * xx + G[4] * xy + G[5] * xz);
        work[2 * nv + c] = (G[1] * xx + G[3] * xy + G[4] * xz) - (G[0] * xy + G[1] * yy + G[2] * yz);
        work[3 * nv + c] = k[0] * x + k[1] * y + k[2] * z;
        work[4 * nv + c] = k[1] * x + k[3] * y + k[4] * z;
        work[5 * nv + c] = k[2] * x + k[4] * y + k[5] * z;
        work[6 * nv + c] = T[c] + (q * com[2] - r * com[1]);
        work[7 * nv + c] = T[nv + c] + (r * com[0] - p * com[2]);
        work[8 * nv + c] = T[2 * nv + c] + (p * com[1] - q * com[0]);
    }
}

/* The second derivative (nv, nv) of <G, I> by v, world axes, from column first on: inertia_hessian in
 * wbc/robot/inertia.py. work holds ROWS + 1 rows (nv). */
INLINE void second_derivative(const wbc_tree *tree, const double *state, double mass,
                              const double *G, int64_t first, double *restrict work,
                              double *restrict H) {
    const int64_t nv = tree->nv;
    const double *h = state + COM_JACOBIAN(nv), *turn = state + TWISTS(nv) + 3 * nv;
    const double *carried = work + LINEAR_PULL * nv, *at_com = work + AT_COM * nv;
    double *restrict part = work + ROWS * nv;
    pulls(nv, state, mass, G, work);
    for (int64_t b = first; b < nv; b++) {
        const double x = -2.0 * carried[b], y = -2.0 * carried[nv + b], z = -2.0 * carried[2 * nv + b];
        for (int64_t a = 0; a < nv; a++)
            H[b * nv + a] = x * h[a] + y * h[nv + a] + z * h[2 * nv + a];
    }
    for (int64_t a = first; a < 6; a++) { /* the base carries all */
        double by[6];
        for (int i = 0; i < 3; i++) by[i] = turn[i * nv + a], by[3 + i] = at_com[i * nv + a];
        for (int64_t b = 0; b < nv; b++)
            part[b] = (by[0] * work[b] + by[1] * work[nv + b] + by[2] * work[2 * nv + b]) +
                      (by[3] * work[3 * nv + b] + by[4] * work[4 * nv + b] + by[5] * work[5 * nv + b]);
        for (int64_t b = 0; b < nv; b++) {
            const double change = b < 6 ? part[b] : 2.0 * part[b];
            H[a * nv + b] += change, H[b * nv + a] += change;
        }
    }
    for (int64_t j = 2; j < tree->joints; j++)
        for (int64_t i = j; i > 1; i = tree->parent[i]) { /* joints that carry this one, and itself */
            const int64_t a = tree->iv[i], b = tree->iv[j];
            double sum = 0.0;
            for (int r = 0; r < 3; r++)
                sum += work[r * nv + b] * turn[r * nv + a] + carried[r * nv + b] * at_com[r * nv + a];
            H[a * nv + b] += 2.0 * sum;
            if (i != j) H[b * nv + a] += 2.0 * sum;
        }
}

WIDE void damp_by_curvature(const wbc_plan *plan, const wbc_block *block, const double *state,
                            const double *frames, const double *e, double factor, double *work,
                            double *P, int64_t n) {
    const int64_t nv = plan->tree->nv, k = block->rows, first = block->frame < 0 ? 0 : 6;
    const double *weight = plan->number + block->number + WEIGHTS, *own = weight + 3 * k;
    double pull[6] = {0.0}, G[6], *H = work + (ROWS + 1) * nv;
    for (int64_t i = 0; i < k; i++)
        for (int j = 0; j < 6; j++) pull[j] += weight[i] * weight[i] * e[i] * own[6 * i + j];
    pull[1] *= 0.5, pull[2] *= 0.5, pull[4] *= 0.5; /* these entries stand twice in the matrix */
    if (block->frame < 0)
        memcpy(G, pull, sizeof G);
    else
        congruent(frames + block->frame * FRAME_SIZE(nv) + FRAME_ROTATION, pull, G);
    second_derivative(plan->tree, state, plan->mass, G, first, work, H);
    double *sum = work; /* of columns: H is symmetric, and no sum waits for itself */
    memset(sum, 0, nv * sizeof *sum);
    for (int64_t a = first; a < nv; a++)
        for (int64_t b = first; b < nv; b++) sum[b] += fabs(H[a * nv + b]);
    for (int64_t a = first; a < nv; a++) P[a * n + a] += factor * sum[a];
}
