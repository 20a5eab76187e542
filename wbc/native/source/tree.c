/* The kinematic tree at one state: placements, CoM, centroidal map, CRB inertia and its Jacobian.
 *
 * Positions are taken from the base, then from the CoM: far from the world's origin nothing is lost
 * in differences. A joint moves the bodies that it carries as one; with their mass m, first moment
 * h and inertia I about the robot's CoM, and the joint's angular velocity w and velocity u there,
 *
 *     linear  = m u + w x h        angular = h x u + I w
 *     dI/dt   = [w] I - I [w] + 2 (u.h) 1 - u h' - h u'          (paper eqs. 24-27)
 */
#include "linear.h"
#include "tree.h"

#include <string.h>

/* Larger entries are not measurements, and rounding would dominate: at 1e6 m the inertia about the CoM, a
 * difference of terms m p^2, has a few digits left. */
const double wbc_unit = 1e-3, wbc_unit_rounding = 4e-16, wbc_largest_state = 1e6;

/* R = P times the rotation about a unit axis by the angle with c = cos, s = sin. */
static void turned(const double *P, const double *axis, double c, double s, double *R) {
    const double x = axis[0], y = axis[1], z = axis[2], d = 1.0 - c;
    const double turn[9] = {
        c + d * x * x,     d * x * y - s * z, d * x * z + s * y, d * x * y + s * z, c + d * y * y,
        d * y * z - s * x, d * x * z - s * y, d * y * z + s * x, c + d * z * z,
    };
    product3(P, turn, R);
}

/* Rotation and origin of a joint in its parent, from its coordinates in q. */
static void place_in_parent(const wbc_tree *tree, int64_t j, const double *value, double *local, double *shift) {
    const double *P = tree->placement + 12 * j, *axis = tree->axis + 3 * j;
    double turn[3];
    for (int i = 0; i < 3; i++) shift[i] = P[9 + i];
    switch (tree->kind[j]) {
    case REVOLUTE:
        turned(P, axis, cos(value[0]), sin(value[0]), local);
        break;
    case CONTINUOUS:
        turned(P, axis, value[0], value[1], local);
        break;
    default: /* prismatic */
        times3(P, axis, turn);
        for (int i = 0; i < 9; i++) local[i] = P[i];
        for (int i = 0; i < 3; i++) shift[i] += value[0] * turn[i];
    }
}

/* Rotation of a joint, and its origin relative to the base's. */
static void place(const wbc_tree *tree, int64_t j, const double *q, double *rotations, double *arms) {
    const double *parent = rotations + 9 * tree->parent[j];
    double local[9], shift[3], turn[3];
    place_in_parent(tree, j, q + tree->iq[j], local, shift);
    product3(parent, local, rotations + 9 * j);
    times3(parent, shift, turn);
    for (int i = 0; i < 3; i++) arms[3 * j + i] = arms[3 * tree->parent[j] + i] + turn[i];
}

/* Mass, first moment and inertia (10) of a body about the base's origin. */
static void body_inertia(const double *body, const double *R, const double *arm, double *out) {
    double c[3];
    times3(R, body + 1, c);
    for (int i = 0; i < 3; i++) c[i] += arm[i];
    out[0] = body[0];
    for (int i = 0; i < 3; i++) out[1 + i] = body[0] * c[i];
    congruent(R, body + 4, out + 4);
    add_turning(out + 4, 0.5 * body[0], c, c);
}

/* The same about another point, at c. */
static void about_point(const double *from, const double *c, double *out) {
    out[0] = from[0];
    for (int i = 0; i < 3; i++) out[1 + i] = from[1 + i] - from[0] * c[i];
    for (int i = 4; i < 10; i++) out[i] = from[i];
    add_turning(out + 4, -1.0, from + 1, c);
    add_turning(out + 4, 0.5 * from[0], c, c);
}

/* Rows (nv) of scratch, for each column of v: its axis; 1 if it rotates, 0 if it translates; the vector from its
 * joint to the CoM; mass, first moment and inertia about the CoM of its subtree. */
enum { AXIS = 0, TURNS = 3, TO_COM = 4, CARRIED = 7, COLUMN_ROWS = 17 };

/* The maps from these rows, for all columns side by side. */
WIDE static void fill_maps(int64_t n, double mass, const double *columns, double *state) {
    const double *axis = columns, *turns = columns + TURNS * n;
    const double *way = columns + TO_COM * n, *Y = columns + CARRIED * n;
    double *A = state + CENTROIDAL_MAP, *J = state + COM_JACOBIAN(n);
    double *dI = state + INERTIA_JACOBIAN(n), *T = state + TWISTS(n);
    const double X = state[COM], Y0 = state[COM + 1], Z = state[COM + 2];
    INDEPENDENT
    for (int64_t c = 0; c < n; c++) {
        const double x = axis[c], y = axis[n + c], z = axis[2 * n + c], t = turns[c], s = 1.0 - t;
        const double rx = way[c], ry = way[n + c], rz = way[2 * n + c];
        const double ox = X - rx, oy = Y0 - ry, oz = Z - rz; /* of the joint, in the world */
        const double wx = t * x, wy = t * y, wz = t * z;
        const double ux = s * x + (wy * rz - wz * ry), uy = s * y + (wz * rx - wx * rz);
        const double uz = s * z + (wx * ry - wy * rx);
        const double m = Y[c], hx = Y[n + c], hy = Y[2 * n + c], hz = Y[3 * n + c];
        const double xx = Y[4 * n + c], xy = Y[5 * n + c], xz = Y[6 * n + c];
        const double yy = Y[7 * n + c], yz = Y[8 * n + c], zz = Y[9 * n + c];
        const double lx = m * ux + (wy * hz - wz * hy), ly = m * uy + (wz * hx - wx * hz);
        const double lz = m * uz + (wx * hy - wy * hx), twice = 2.0 * (ux * hx + uy * hy + uz * hz);
        T[c] = s * x + (oy * wz - oz * wy);
        T[n + c] = s * y + (oz * wx - ox * wz);
        T[2 * n + c] = s * z + (ox * wy - oy * wx);
        T[3 * n + c] = wx, T[4 * n + c] = wy, T[5 * n + c] = wz;
        A[c] = lx, A[n + c] = ly, A[2 * n + c] = lz;
        A[3 * n + c] = (hy * uz - hz * uy) + (xx * wx + xy * wy + xz * wz);
        A[4 * n + c] = (hz * ux - hx * uz) + (xy * wx + yy * wy + yz * wz);
        A[5 * n + c] = (hx * uy - hy * ux) + (xz * wx + yz * wy + zz * wz);
        J[c] = lx / mass, J[n + c] = ly / mass, J[2 * n + c] = lz / mass;
        dI[c] = 2.0 * (xz * wy - xy * wz) + (twice - 2.0 * ux * hx);
        dI[n + c] = (yz * wy - xz * wx + (xx - yy) * wz) - (ux * hy + uy * hx);
        dI[2 * n + c] = (xy * wx - yz * wz + (zz - xx) * wy) - (ux * hz + uz * hx);
        dI[3 * n + c] = 2.0 * (xy * wz - yz * wx) + (twice - 2.0 * uy * hy);
        dI[4 * n + c] = ((yy - zz) * wx - xy * wy + xz * wz) - (uy * hz + uz * hy);
        dI[5 * n + c] = 2.0 * (yz * wx - xz * wy) + (twice - 2.0 * uz * hz);
    }
}

void place_joints(const wbc_tree *tree, const double *q, double *state, double *arms) {
    const int64_t n = tree->joints;
    double *R = state + ROTATIONS(tree->nv), *origins = state + ORIGINS(tree->nv, n);
    double *base = origins + 3, local[9];
    for (int i = 0; i < 9; i++) R[i] = i % 4 == 0;
    for (int i = 0; i < 3; i++) origins[i] = arms[i] = arms[3 + i] = 0.0;
    from_quaternion(q + 3, local);
    product3(tree->placement + 12, local, R + 9);
    times3(tree->placement + 12, q, base);
    for (int i = 0; i < 3; i++) base[i] += tree->placement[21 + i];
    for (int64_t j = 2; j < n; j++) {
        place(tree, j, q, R, arms);
        for (int i = 0; i < 3; i++) origins[3 * j + i] = base[i] + arms[3 * j + i];
    }
}

/* Write p, quaternion x y z w of q, moved for unit time by u and w in its own axes. */
static void integrate_base(const double *from, const double *u, const double *w, double *to) {
    const double angle = sqrt(dot3(w, w)), square = angle * angle, half = 0.5 * angle;
    const int small = angle < 1e-2; /* series, exact to rounding */
    const double s = small ? 0.5 - square / 48.0 + square * square / 3840.0 : sin(half) / angle;
    const double one = small ? 0.5 - square / 24.0 + square * square / 720.0 : 2.0 * s * s; /* (1 - cos) / angle^2 */
    const double two =
        small ? 1.0 / 6.0 - square / 120.0 + square * square / 5040.0 : (angle - sin(angle)) / (square * angle);
    const double x = s * w[0], y = s * w[1], z = s * w[2], r = cos(half), *q = from + 3;
    double turn[3], twice[3], path[3], R[9], norm;
    cross3(w, u, turn);
    cross3(w, turn, twice);
    for (int i = 0; i < 3; i++) turn[i] = u[i] + one * turn[i] + two * twice[i];
    from_quaternion(q, R);
    times3(R, turn, path);
    for (int i = 0; i < 3; i++) to[i] = from[i] + path[i];
    to[3] = q[3] * x + q[0] * r + q[1] * z - q[2] * y;
    to[4] = q[3] * y + q[1] * r + q[2] * x - q[0] * z;
    to[5] = q[3] * z + q[2] * r + q[0] * y - q[1] * x;
    to[6] = q[3] * r - q[0] * x - q[1] * y - q[2] * z;
    norm = r < 0.0 ? -1.0 : 1.0; /* of the two quaternions the nearer one */
    norm *= sqrt(dot3(to + 3, to + 3) + to[6] * to[6]);
    for (int i = 3; i < 7; i++) to[i] /= norm;
}

/* Move a joint's coordinates by an angle or a length. */
static void integrate_joint(int64_t kind, const double *from, double by, double *to) {
    if (kind == CONTINUOUS) {
        const double c = cos(by), s = sin(by);
        to[0] = from[0] * c - from[1] * s, to[1] = from[1] * c + from[0] * s;
    } else to[0] = from[0] + by;
}

int wbc_integrate(const wbc_tree *tree, const double *q, const double *step, double *out) {
    integrate_base(q, step, step + 3, out);
    for (int64_t j = 2; j < tree->joints; j++)
        integrate_joint(tree->kind[j], q + tree->iq[j], step[tree->iv[j]], out + tree->iq[j]);
    return 0;
}

int64_t configuration_size(const wbc_tree *tree) {
    const int64_t last = tree->joints - 1;
    return last < 2 ? 7 : tree->iq[last] + (tree->kind[last] == CONTINUOUS ? 2 : 1);
}

const double *velocity_of(const wbc_tree *tree, const double *q, const double *v) {
    return v ? v : q + configuration_size(tree);
}

int is_measured(const double *values, int64_t n) {
    for (int64_t i = 0; i < n; i++)
        if (!(fabs(values[i]) <= wbc_largest_state)) return 0; /* NaN is not */
    return 1;
}

/* Normalise a vector of norm 1 but for rounding; false if it is not. */
static int normalise(double *values, int64_t n) {
    double norm = 0.0;
    for (int64_t i = 0; i < n; i++) norm += values[i] * values[i];
    norm = sqrt(norm);
    if (fabs(norm - 1.0) > wbc_unit) return 0;
    for (int64_t i = 0; i < n && fabs(norm - 1.0) > wbc_unit_rounding; i++) values[i] /= norm;
    return 1;
}

int wbc_check(const wbc_tree *tree, const void *q, const void *v, double *out) {
    const int64_t nq = configuration_size(tree);
    memcpy(out, q, nq * sizeof *out);
    memcpy(out + nq, v, tree->nv * sizeof *out);
    if (!is_measured(out, nq + tree->nv) || !normalise(out + 3, 4)) return NOT_FINITE;
    for (int64_t j = 2; j < tree->joints; j++)
        if (tree->kind[j] == CONTINUOUS && !normalise(out + tree->iq[j], 2)) return NOT_FINITE;
    return DONE;
}

int wbc_move(const wbc_tree *tree, const double *q, const double *v, double dt, double *out) {
    double *step = out + configuration_size(tree), *there = step + tree->nv;
    if (wbc_check(tree, q, v, out) != DONE) return NOT_FINITE;
    for (int64_t i = 0; i < tree->nv; i++) step[i] *= dt;
    wbc_integrate(tree, out, step, there);
    return is_measured(there, configuration_size(tree)) ? DONE : NOT_FINITE;
}

int64_t wbc_moves(const wbc_tree *tree, int64_t n, const double *q, const double *step, double *scratch,
                  double *out) {
    const int64_t nq = configuration_size(tree);
    for (int64_t k = 0; k < n; k++) {
        if (wbc_move(tree, q + k * nq, step + k * tree->nv, 1.0, scratch) != DONE) return k;
        memcpy(out + k * nq, scratch + nq + tree->nv, nq * sizeof *out);
    }
    return n;
}

int wbc_places(const wbc_tree *tree, wbc_state_places *state, wbc_motion_places *motion) {
    const int64_t nv = tree->nv, joints = tree->joints, drifts = DRIFTS(nv);
    const wbc_state_places in_state = {
        COM,
        INERTIA,
        MOMENTUM,
        CENTROIDAL_MAP,
        COM_JACOBIAN(nv),
        INERTIA_JACOBIAN(nv),
        TWISTS(nv),
        ROTATIONS(nv),
        ORIGINS(nv, joints),
        FRAMES(nv, joints),
    };
    const wbc_motion_places in_motion = {
        0,
        BIAS(nv),
        drifts + COM_DRIFT,
        drifts + MOMENTUM_DRIFT,
        drifts + INERTIA_RATE,
        drifts + INERTIA_CURVATURE,
        JOINT_MOTION(nv),
        MOTION_SIZE(nv, joints),
    };
    *state = in_state, *motion = in_motion;
    return 0;
}

int wbc_state(const wbc_tree *tree, const double *q, const double *v, double *state, double *scratch, int64_t frames,
              const int64_t *joint, const double *placement) {
    const int64_t n = tree->joints, nv = tree->nv;
    const double *R = state + ROTATIONS(nv), *base = state + ORIGINS(nv, n) + 3;
    double *arms = scratch, *composite = scratch + 3 * n, *columns = composite + 10 * n, com[3];
    place_joints(tree, q, state, arms);
    for (int64_t j = 1; j < n; j++) body_inertia(tree->body + 10 * j, R + 9 * j, arms + 3 * j, composite + 10 * j);
    for (int64_t j = n - 1; j > 1; j--)
        for (int i = 0; i < 10; i++) composite[10 * tree->parent[j] + i] += composite[10 * j + i];

    const double mass = composite[10];
    for (int i = 0; i < 3; i++) com[i] = composite[11 + i] / mass;
    for (int i = 0; i < 3; i++) state[COM + i] = base[i] + com[i];
    for (int64_t j = 1; j < n; j++) {
        int64_t k;
        const int64_t behind = columns_of(tree, j, &k);
        double moved[10];
        about_point(composite + 10 * j, com, moved);
        for (; k < behind; k++) {
            double axis[3];
            if (j == 1)
                for (int i = 0; i < 3; i++) axis[i] = R[9 + 3 * i + k % 3];
            else times3(R + 9 * j, tree->axis + 3 * j, axis);
            columns[TURNS * nv + k] = j == 1 ? k > 2 : tree->kind[j] != PRISMATIC;
            for (int i = 0; i < 3; i++) columns[(AXIS + i) * nv + k] = axis[i];
            for (int i = 0; i < 3; i++) columns[(TO_COM + i) * nv + k] = com[i] - arms[3 * j + i];
            for (int i = 0; i < 10; i++) columns[(CARRIED + i) * nv + k] = moved[i];
        }
        if (j > 1) continue;
        const double *I = moved + 4;
        const double full[9] = {I[0], I[1], I[2], I[1], I[3], I[4], I[2], I[4], I[5]};
        for (int i = 0; i < 9; i++) state[INERTIA + i] = full[i];
    }
    fill_maps(nv, mass, columns, state);
    for (int i = 0; i < 6; i++) state[MOMENTUM + i] = dot(nv, state + CENTROIDAL_MAP + i * nv, v);
    return wbc_frames(tree, state, frames, joint, placement, state + FRAMES(nv, n));
}

/* Momentum (6) of a mass, first moment and inertia at a twist. */
static void times6(const double *Y, const double *twist, double *out) {
    double pulled[3], swept[3];
    cross3(twist + 3, Y + 1, pulled);
    cross3(Y + 1, twist, swept);
    symmetric_times(Y + 4, twist + 3, out + 3);
    for (int i = 0; i < 3; i++) out[i] = Y[0] * twist[i] + pulled[i], out[3 + i] += swept[i];
}

/* out += a x b of twists; if dual, of a twist and a momentum. */
static void add_cross6(const double *a, const double *b, int dual, double *out) {
    double turned[3], spun[3], moved[3];
    cross3(a + 3, b, turned);
    cross3(a + 3, b + 3, spun);
    cross3(a, dual ? b : b + 3, moved);
    for (int i = 0; i < 3; i++) {
        out[i] += turned[i] + (dual ? 0.0 : moved[i]);
        out[3 + i] += spun[i] + (dual ? moved[i] : 0.0);
    }
}

int wbc_momentum_jacobian(const wbc_tree *tree, const double *state, const double *v, double *scratch, double *out) {
    const int64_t n = tree->joints, nv = tree->nv;
    const double *A = state + CENTROIDAL_MAP, *J = state + COM_JACOBIAN(nv), *p = state + MOMENTUM;
    const double *columns = scratch + 13 * n;
    double *V = scratch, *own = V + 6 * n, S[6]; /* twists, and the momentum that columns give to their subtrees */
    memset(V, 0, 12 * n * sizeof *V);
    for (int64_t j = 1; j < n; j++) {
        int64_t k;
        const int64_t behind = columns_of(tree, j, &k);
        memcpy(V + 6 * j, V + 6 * tree->parent[j], 6 * sizeof *V);
        for (; k < behind; k++) {
            twist_at_com(nv, state, k, S, S + 3);
            for (int i = 0; i < 6; i++) V[6 * j + i] += v[k] * S[i], own[6 * j + i] += v[k] * A[i * nv + k];
        }
    }
    for (int64_t j = n - 1; j > 1; j--)
        for (int i = 0; i < 6; i++) own[6 * tree->parent[j] + i] += own[6 * j + i];
    for (int64_t j = 1; j < n; j++) {
        int64_t k;
        const int64_t behind = columns_of(tree, j, &k);
        const double *carrier = V + 6 * tree->parent[j];
        double Y[10], L[6], turn[6], change[6];
        for (int i = 0; i < 10; i++) Y[i] = columns[(CARRIED + i) * nv + k];
        times6(Y, carrier, L);
        for (int i = 0; i < 6; i++) L[i] += own[6 * j + i];
        for (; k < behind; k++) {
            twist_at_com(nv, state, k, S, S + 3);
            memset(turn, 0, sizeof turn);
            add_cross6(carrier, S, 0, turn);
            times6(Y, turn, change);
            add_cross6(S, L, 1, change);
            const double com[3] = {J[k], J[nv + k], J[2 * nv + k]};
            double lost[3];
            cross3(com, p, lost);
            for (int i = 0; i < 3; i++) change[3 + i] -= lost[i];
            for (int i = 0; i < 6; i++) out[i * nv + k] = change[i];
        }
    }
    return 0;
}

int wbc_states(const wbc_tree *tree, int64_t n, const double *q, const double *v, double *states, double *scratch,
               int64_t frames, const int64_t *joint, const double *placement, double *change) {
    const int64_t nv = tree->nv, nq = configuration_size(tree);
    const int64_t size = FRAMES(nv, tree->joints) + frames * FRAME_SIZE(nv);
    for (int64_t k = 0; k < n; k++, q += nq, v += nv, states += size) {
        wbc_state(tree, q, v, states, scratch, frames, joint, placement);
        if (change) wbc_momentum_jacobian(tree, states, v, scratch, change + 6 * nv * k);
    }
    return 0;
}

int wbc_frames(const wbc_tree *tree, const double *state, int64_t count, const int64_t *joint,
               const double *placement, double *out) {
    const int64_t nv = tree->nv;
    const double *T = state + TWISTS(nv);
    for (int64_t f = 0; f < count; f++, out += FRAME_SIZE(nv), placement += 12) {
        double *J = out + FRAME_JACOBIAN, u[3];
        place_frame(tree, state, joint[f], placement, 1, out);
        for (int64_t k = 0; k < 6 * nv; k++) J[k] = 0.0;
        for (int64_t j = joint[f]; j > 0; j = tree->parent[j]) {
            int64_t first;
            const int64_t behind = columns_of(tree, j, &first);
            for (int64_t k = first; k < behind; k++) {
                speed_at(tree, state, j, k, out, u);
                for (int i = 0; i < 3; i++) J[i * nv + k] = u[i], J[(3 + i) * nv + k] = T[(3 + i) * nv + k];
            }
        }
    }
    return 0;
}

int wbc_frame_poses(const wbc_tree *tree, const double *state, int64_t count, const int64_t *joint,
                    const double *placement, double *out) {
    for (int64_t f = 0; f < count; f++) place_frame(tree, state, joint[f], placement + 12 * f, 1, out + 12 * f);
    return 0;
}
