/* Dynamics of the tree at a velocity v: mass matrix, bias forces, and the second derivatives at zero
 * acceleration of v (drifts) of CoM, momentum, CRB inertia and frames.
 *
 * Everything is about the robot's CoM. A column's twist (u at the CoM, w) times the momentum that another column
 * gives to the bodies that both move is an entry of the mass matrix; times the forces that these bodies need at
 * zero acceleration, of the bias.
 */
#include "core.h"
#include "linear.h"
#include "tree.h"

#include <string.h>

/* Acceleration of a point at an arm from one with acceleration c; out may be c. */
static void carried(const double *c, const double *alpha, const double *w, const double *arm, double *out) {
    double speed[3], inward[3], tangential[3];
    cross3(w, arm, speed);
    cross3(w, speed, inward);
    cross3(alpha, arm, tangential);
    for (int i = 0; i < 3; i++) out[i] = c[i] + inward[i] + tangential[i];
}

/* Angular velocity, angular acceleration, acceleration and velocity of every joint's origin. */
static void move_joints(const wbc_tree *tree, const double *state, const double *v, double *motion,
                        double *velocity) {
    const int64_t nv = tree->nv, n = tree->joints;
    const double *origins = state + ORIGINS(nv, n), *R = state + ROTATIONS(nv) + 9;
    double *joints = motion + JOINT_MOTION(nv), *base = joints + JOINT_MOTION_SIZE;
    memset(joints, 0, 2 * JOINT_MOTION_SIZE * sizeof *joints);
    memset(velocity, 0, 3 * sizeof *velocity);
    times3(R, v + 3, base + OMEGA);
    times3(R, v, velocity + 3);
    cross3(base + OMEGA, velocity + 3, base + ACCELERATION); /* of velocities in rotating axes */
    for (int64_t j = 2; j < n; j++) {
        const double *parent = joints + JOINT_MOTION_SIZE * tree->parent[j], *w = parent + OMEGA;
        const double *T = state + TWISTS(nv) + tree->iv[j], rate = v[tree->iv[j]];
        const int slides = tree->kind[j] == PRISMATIC;
        double *own = joints + JOINT_MOTION_SIZE * j, arm[3], along[3], turn[3], carry[3];
        for (int i = 0; i < 3; i++) {
            arm[i] = origins[3 * j + i] - origins[3 * tree->parent[j] + i];
            along[i] = rate * T[(slides ? i : 3 + i) * nv];
            own[OMEGA + i] = w[i] + (slides ? 0.0 : along[i]);
        }
        cross3(w, along, turn);
        cross3(w, arm, carry);
        carried(parent + ACCELERATION, parent + ALPHA, w, arm, own + ACCELERATION);
        for (int i = 0; i < 3; i++) {
            own[ALPHA + i] = parent[ALPHA + i] + (slides ? 0.0 : turn[i]);
            own[ACCELERATION + i] += slides ? 2.0 * turn[i] : 0.0; /* Coriolis */
            velocity[3 * j + i] = velocity[3 * tree->parent[j] + i] + carry[i] + (slides ? along[i] : 0.0);
        }
    }
}

/* A body: its CoM relative to the robot's, the CoM's velocity and acceleration, its inertia. */
typedef struct {
    double mass, arm[3], velocity[3], acceleration[3], inertia[6];
} moving_body;

static void move_body(const wbc_tree *tree, const double *state, const double *motion, const double *velocity,
                      int64_t j, moving_body *body) {
    const int64_t nv = tree->nv;
    const double *R = state + ROTATIONS(nv) + 9 * j, *own = tree->body + 10 * j;
    const double *joint = motion + JOINT_MOTION(nv) + JOINT_MOTION_SIZE * j;
    double arm[3], turn[3];
    body->mass = own[0];
    times3(R, own + 1, arm);
    cross3(joint + OMEGA, arm, turn);
    carried(joint + ACCELERATION, joint + ALPHA, joint + OMEGA, arm, body->acceleration);
    for (int i = 0; i < 3; i++) {
        body->velocity[i] = velocity[3 * j + i] + turn[i];
        body->arm[i] = state[ORIGINS(nv, tree->joints) + 3 * j + i] - state[COM + i] + arm[i];
    }
    congruent(R, own + 4, body->inertia);
}

/* Add a body's part of the first and second derivative of the inertia about the moving CoM. */
static void add_inertia(const moving_body *body, const double *joint, const double *com_velocity,
                        const double *com_acceleration, double *rate, double *curvature) {
    double spin[6] = {0.0}, speed[3], push[3];
    for (int i = 0; i < 3; i++) {
        speed[i] = body->velocity[i] - com_velocity[i];
        push[i] = body->acceleration[i] - com_acceleration[i];
    }
    add_commutator(spin, body->inertia, joint + OMEGA);
    for (int i = 0; i < 6; i++) rate[i] += spin[i];
    add_turning(rate, body->mass, body->arm, speed);
    add_commutator(curvature, body->inertia, joint + ALPHA);
    add_commutator(curvature, spin, joint + OMEGA);
    add_turning(curvature, body->mass, speed, speed);
    add_turning(curvature, body->mass, body->arm, push);
}

/* Add the force and the moment about the robot's CoM that accelerate a body, beyond m times "lost". */
static void add_force(const moving_body *body, const double *joint, const double *lost, double *wrench) {
    double force[3], moment[3], spin[3], gyro[3], turn[3];
    for (int i = 0; i < 3; i++) force[i] = body->mass * (body->acceleration[i] - lost[i]);
    cross3(body->arm, force, moment);
    symmetric_times(body->inertia, joint + OMEGA, spin);
    cross3(joint + OMEGA, spin, gyro);
    symmetric_times(body->inertia, joint + ALPHA, turn);
    for (int i = 0; i < 3; i++) {
        wrench[i] += force[i];
        wrench[3 + i] += moment[i] + gyro[i] + turn[i];
    }
}

/* The mass matrix: the momentum that a column gives to its subtree, times the other columns. */
static void mass_matrix(const wbc_tree *tree, const double *state, const double *twists, double *M) {
    const int64_t nv = tree->nv;
    memset(M, 0, nv * nv * sizeof *M);
    for (int64_t j = 1; j < tree->joints; j++) {
        int64_t first, begin;
        const int64_t last = columns_of(tree, j, &first);
        for (int64_t k = first; k < last; k++) {
            double A[6];
            for (int r = 0; r < 6; r++) A[r] = state[CENTROIDAL_MAP + r * nv + k];
            for (int64_t above = j; above > 0; above = tree->parent[above]) {
                const int64_t end = columns_of(tree, above, &begin);
                for (int64_t i = begin; i < end; i++) {
                    const double *t = twists + 6 * i;
                    M[i * nv + k] = M[k * nv + i] = dot3(t, A) + dot3(t + 3, A + 3);
                }
            }
        }
    }
    for (int64_t k = 0; k < nv; k++) M[k * nv + k] += tree->armature[k];
}

int wbc_motion(const wbc_tree *tree, const double *state, const double *v, double *motion, double *scratch) {
    const int64_t nv = tree->nv, n = tree->joints;
    const double *joints = motion + JOINT_MOTION(nv), none[3] = {0.0};
    double *velocity = scratch, *wrench = scratch + 3 * n, *twists = wrench + 6 * n;
    double *drift = motion + DRIFTS(nv), mean[3] = {0.0}, *push = drift + COM_DRIFT, mass = 0.0;
    moving_body body;
    move_joints(tree, state, v, motion, velocity);
    for (int64_t k = 0; k < nv; k++) twist_at_com(nv, state, k, twists + 6 * k, twists + 6 * k + 3);
    mass_matrix(tree, state, twists, motion);
    memset(drift, 0, DRIFTS_SIZE * sizeof *drift);
    memset(wrench, 0, 6 * n * sizeof *wrench);
    for (int64_t j = 1; j < n; j++) {
        move_body(tree, state, motion, velocity, j, &body);
        add_force(&body, joints + JOINT_MOTION_SIZE * j, none, drift + MOMENTUM_DRIFT);
        add_force(&body, joints + JOINT_MOTION_SIZE * j, tree->gravity, wrench + 6 * j);
        mass += body.mass;
        for (int i = 0; i < 3; i++) mean[i] += body.mass * body.velocity[i];
    }
    for (int i = 0; i < 3; i++) mean[i] /= mass, push[i] = drift[MOMENTUM_DRIFT + i] / mass;
    for (int64_t j = n - 1; j > 0; j--) {
        int64_t first;
        const int64_t last = columns_of(tree, j, &first);
        for (int64_t k = first; k < last; k++) {
            const double *t = twists + 6 * k;
            motion[BIAS(nv) + k] = dot3(t, wrench + 6 * j) + dot3(t + 3, wrench + 6 * j + 3);
        }
        for (int i = 0; i < 6; i++) wrench[6 * tree->parent[j] + i] += wrench[6 * j + i];
        move_body(tree, state, motion, velocity, j, &body);
        add_inertia(&body, joints + JOINT_MOTION_SIZE * j, mean, push, drift + INERTIA_RATE,
                    drift + INERTIA_CURVATURE);
    }
    return 0;
}

int wbc_drifts(const wbc_tree *tree, const double *state, const double *motion, int64_t count, const int64_t *joint,
               const double *placement, double *out) {
    const int64_t nv = tree->nv;
    for (int64_t f = 0; f < count; f++, out += 6, placement += 12) {
        const double *own = motion + JOINT_MOTION(nv) + JOINT_MOTION_SIZE * joint[f];
        double arm[3];
        times3(state + ROTATIONS(nv) + 9 * joint[f], placement + 9, arm);
        carried(own + ACCELERATION, own + ALPHA, own + OMEGA, arm, out);
        for (int i = 0; i < 3; i++) out[3 + i] = own[ALPHA + i];
    }
    return 0;
}
