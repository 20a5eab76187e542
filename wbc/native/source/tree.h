/* Poses of the joints of a tree, and the columns that move them. */
#ifndef WBC_TREE_H
#define WBC_TREE_H

#include "core.h"
#include "linear.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* Whether all numbers are finite and of a size that states may have. */
int is_measured(const double *values, int64_t n);

/* The size nq of a configuration. */
int64_t configuration_size(const wbc_tree *tree);
/* v; or, if that is 0, the velocity that lies behind q. */
const double *velocity_of(const wbc_tree *tree, const double *q, const double *v);

/* The columns of v that move a joint: from first up to the one returned. */
static inline int64_t columns_of(const wbc_tree *tree, int64_t j, int64_t *first) {
    *first = j == 1 ? 0 : tree->iv[j];
    return j == 1 ? 6 : *first + 1;
}

/* Write the velocity (3) that column k, of joint j, gives to a point fixed to the joint. */
static inline void speed_at(const wbc_tree *tree, const double *state, int64_t j, int64_t k, const double *point,
                            double *u) {
    const int64_t nv = tree->nv, slides = j == 1 ? k < 3 : tree->kind[j] == PRISMATIC;
    const double *T = state + TWISTS(nv) + k, *origin = state + ORIGINS(nv, tree->joints) + 3 * j;
    const double axis[3] = {T[3 * nv], T[4 * nv], T[5 * nv]};
    double arm[3];
    for (int i = 0; i < 3; i++) arm[i] = point[i] - origin[i];
    cross3(axis, arm, u);
    for (int i = 0; i < 3 && slides; i++) u[i] = T[i * nv];
}

/* Velocity and angular velocity of column k at the CoM. */
static inline void twist_at_com(int64_t nv, const double *state, int64_t k, double *u, double *w) {
    const double *T = state + TWISTS(nv) + k;
    for (int i = 0; i < 3; i++) w[i] = T[(3 + i) * nv];
    cross3(w, state + COM, u);
    for (int i = 0; i < 3; i++) u[i] += T[i * nv];
}

/* Write origin and, if turns, rotation (12) of a frame from its joint and its placement there. */
static inline void place_frame(const wbc_tree *tree, const double *state, int64_t joint, const double *placement,
                               int turns, double *out) {
    const double *R = state + ROTATIONS(tree->nv) + 9 * joint;
    const double *origin = state + ORIGINS(tree->nv, tree->joints) + 3 * joint;
    times3(R, placement + 9, out);
    for (int i = 0; i < 3; i++) out[i] += origin[i];
    if (turns) product3(R, placement, out + FRAME_ROTATION);
}

/* Write rotations and origins of all joints at q into a state; arms holds 3 numbers a joint. */
void place_joints(const wbc_tree *tree, const double *q, double *state, double *arms);

#pragma GCC visibility pop

#endif
