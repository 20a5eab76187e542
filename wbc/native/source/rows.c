/* Errors, Jacobians and drifts of tasks and contacts, in ticks and on request (wbc/tasks/core_task.py). */
#include "rows.h"
#include "rotation.h"

#include <string.h>

int wbc_logarithms(int64_t n, const double *R, double *r) {
    for (int64_t k = 0; k < n; k++) logarithm(R + 9 * k, r + 3 * k);
    return 0;
}

/* J of d(log R)/dt = J w, w in R's own axes: 1 + [r]/2 + c [r]^2. */
static void log_jacobian(const double *r, double *J) {
    const double t2 = dot3(r, r), t = sqrt(t2);
    const double c = t < SMALL_ANGLE ? 1.0 / 12 + t2 * (1.0 / 720 + t2 * (1.0 / 30240 + t2 / 1209600))
                                     : 1.0 / t2 - 1.0 / (2.0 * t * tan(0.5 * t));
    const double x = 0.5 * r[0], y = 0.5 * r[1], z = 0.5 * r[2];
    const double skew[9] = {0.0, -z, y, z, 0.0, -x, -y, x, 0.0};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) J[3 * i + j] = skew[3 * i + j] + c * r[i] * r[j] + (i == j ? 1.0 - c * t2 : 0.0);
}

/* J' x of the same J at a rotation vector that changes at rate: [rate]/2 x + c' [r]^2 x
 * + c ([rate] [r] + [r] [rate]) x, c = 1/t^2 - (1 + cos t) / (2 t sin t). */
static void log_jacobian_rate_times(const double *r, const double *rate, const double *x, double *out) {
    const double t2 = dot3(r, r), t = sqrt(t2);
    double c, slope, rx[3], ratex[3], squared[3], one[3], other[3];
    if (t < SMALL_ANGLE) {
        c = 1.0 / 12 + t2 * (1.0 / 720 + t2 * (1.0 / 30240 + t2 / 1209600));
        slope = t * (1.0 / 360 + t2 * (1.0 / 7560 + t2 / 201600));
    } else {
        const double half = 0.5 * t, cotangent = 1.0 / tan(half);
        c = 1.0 / t2 - cotangent / (2.0 * t);
        slope = -2.0 / (t2 * t) + cotangent / (2.0 * t2) + (1.0 + cotangent * cotangent) / (4.0 * t);
    }
    const double growth = t > 0.0 ? slope * dot3(r, rate) / t : 0.0;
    cross3(r, x, rx);
    cross3(rate, x, ratex);
    cross3(r, rx, squared);
    cross3(rate, rx, one);
    cross3(r, ratex, other);
    for (int i = 0; i < 3; i++) out[i] = 0.5 * ratex[i] + growth * squared[i] + c * (one[i] + other[i]);
}

double joint_position(const wbc_plan *plan, const double *q, int64_t joint) {
    const int64_t start = plan->start[joint];
    return start >= 0 ? q[start] : atan2(q[-start], q[-start - 1]);
}

static int is_continuous(const wbc_plan *plan, int64_t joint) { return plan->start[joint] < 0; }

static void copy_row(double *to, const double *from, int64_t n) { memcpy(to, from, n * sizeof *to); }

/* row = T' (W - W_other) for the angular rows W of two frames. */
static void turn_row(int64_t nv, const double *T, const double *one, const double *other, double *row) {
    one += 3 * nv, other += 3 * nv;
    for (int64_t c = 0; c < nv; c++)
        row[c] = T[0] * (one[c] - other[c]) + T[1] * (one[nv + c] - other[nv + c]) +
                 T[2] * (one[2 * nv + c] - other[2 * nv + c]);
}

/* row = T' W for the angular rows W of a frame's Jacobian. */
static void angular_row(int64_t nv, const double *T, const double *jacobian, double *row) {
    const double *W = jacobian + 3 * nv;
    for (int64_t c = 0; c < nv; c++) row[c] = T[0] * W[c] + T[1] * W[nv + c] + T[2] * W[2 * nv + c];
}

/* Write the world axis of a contact's row 6 or 7, across its line. Returns whether the row is one of them. */
static int across(const double *own, int64_t row, double *axis) {
    if (row < 6) return 0;
    times3(own + 3, own + 12 + 3 * (row - 6), axis);
    return 1;
}

/* row = s' R for six rows R. */
WIDE static void combine(int64_t nv, const double *s, const double *R, double *row) {
    for (int64_t c = 0; c < nv; c++) row[c] = 0.0;
    add_rows(nv, 6, s, R, nv, row);
}

/* The error log(target' R) of a rotation, and T with de/dt = T (w - w*), angular velocities in world axes. */
static void rotation_error(const double *target, const double *R, double *e, double *T) {
    double relative[9], matrix[9];
    transposed_product3(target, R, relative);
    logarithm(relative, e);
    log_jacobian(e, matrix);
    for (int i = 0; i < 3; i++) times3(R, matrix + 3 * i, T + 3 * i);
}

/* Target of a frame relative to another, from the pose (12) and rates (12) wanted in the other's axes: rotation
 * (9), rate and acceleration in world axes. */
static void seen_target(const double *own, const double *there, double *target) {
    product3(there + FRAME_ROTATION, own + 3, target);
    for (int i = 0; i < 2; i++) times3(there + FRAME_ROTATION, own + 15 + 6 * i, target + 9 + 3 * i);
}

void evaluate_block(const wbc_plan *plan, const wbc_block *block, const double *state, const double *frames,
                    const double *q, double *J, double *e, double *bias, double *bound) {
    const int64_t nv = plan->tree->nv, k = block->rows, *chosen = plan->index + block->index;
    const double *number = plan->number + block->number, *weight = number + WEIGHTS;
    const double *own = weight + 3 * k;
    const double *frame = frames + block->frame * FRAME_SIZE(nv);
    const double *jacobian = frame + FRAME_JACOBIAN, *R = frame + FRAME_ROTATION;
    const double trace = state[INERTIA] + state[INERTIA + 4] + state[INERTIA + 8];
    double relative[9], to_error[9], all[6];
    *bound = 0.0;
    copy_row(bias, weight + k, k);
    switch (block->kind) {
    case POINT: {
        const double *position = block->frame < 0 ? state + COM : frame;
        double arm[3], sum = 0.0;
        if (block->frame < 0) jacobian = state + COM_JACOBIAN(nv);
        for (int64_t i = 0; i < k; i++) {
            e[i] = position[chosen[i]] - own[chosen[i]];
            copy_row(J + i * nv, jacobian + chosen[i] * nv, nv);
            sum += weight[i] * weight[i] * e[i] * weight[i] * weight[i] * e[i];
        }
        for (int i = 0; i < 3; i++) arm[i] = position[i] - frames[i];
        *bound = sqrt(sum) * (sqrt(dot3(arm, arm)) + 1.5 * sqrt(trace / own[3]));
        return;
    }
    case ORIENTATION: /* own: target (3, 3), its angular velocity (3) and acceleration (3) */
        rotation_error(own, R, e, to_error);
        for (int i = 0; i < 3; i++) {
            angular_row(nv, to_error + 3 * i, jacobian, J + i * nv);
            bias[i] = -dot3(to_error + 3 * i, own + 9);
        }
        return;
    case POINTING: /* own: target (3), axis (3) in the frame's axes */
        times3(R, own + 3, all);
        for (int64_t i = 0; i < k; i++) { /* d(R axis)/dt = w x R axis */
            const int64_t a = chosen[i], b = (a + 1) % 3, c = (a + 2) % 3;
            const double *turn = jacobian + 3 * nv;
            e[i] = all[a] - own[a];
            for (int64_t j = 0; j < nv; j++) J[i * nv + j] = turn[b * nv + j] * all[c] - turn[c * nv + j] * all[b];
        }
        return;
    case INERTIA_ENTRIES: { /* own: selection (k, 6), targets (k) */
        const double *I = state + INERTIA, *rates = state + INERTIA_JACOBIAN(nv);
        const double entries[6] = {I[0], I[1], I[2], I[4], I[5], I[8]};
        double turn[9];
        memcpy(all, entries, sizeof all);
        if (block->frame >= 0) { /* axes of the base */
            for (int i = 0; i < 9; i++) turn[i] = R[3 * (i % 3) + i / 3];
            congruent(turn, entries, all);
        }
        for (int64_t i = 0; i < k; i++) {
            const double *s = own + 6 * i;
            e[i] = -own[6 * k + i];
            for (int j = 0; j < 6; j++) e[i] += s[j] * all[j];
            if (block->frame < 0) combine(nv, s, rates, J + i * nv);
        }
        for (int64_t c = 0; c < nv && block->frame >= 0; c++) {
            double column[6];
            for (int j = 0; j < 6; j++) column[j] = rates[j * nv + c];
            congruent(turn, column, all);
            for (int64_t i = 0; i < k; i++) {
                double sum = 0.0;
                for (int j = 0; j < 6; j++) sum += own[6 * i + j] * all[j];
                J[i * nv + c] = c < 6 ? 0.0 : sum;
            }
        }
        return;
    }
    case JOINTS: /* own: targets (k); costs need no J, which is 1 at 6 + chosen */
        if (block->held) {
            memset(J, 0, k * nv * sizeof *J);
            for (int64_t i = 0; i < k; i++) J[i * nv + 6 + chosen[i]] = 1.0;
        }
        for (int64_t i = 0; i < k; i++) {
            e[i] = joint_position(plan, q, chosen[i]) - own[i];
            if (is_continuous(plan, chosen[i])) e[i] = remainder(e[i], 2.0 * PI);
        }
        return;
    case MOMENTUM_ENTRIES:
        for (int64_t i = 0; i < k; i++) {
            e[i] = 0.0;
            copy_row(J + i * nv, state + CENTROIDAL_MAP + chosen[i] * nv, nv);
        }
        return;
    case CONTACT: { /* own: position (3), rotation (3, 3); of a line two axes across it (2, 3) */
        double drift[6], turn[3], axis[3];
        for (int i = 0; i < 3; i++) drift[i] = frame[i] - own[i];
        transposed_product3(own + 3, R, relative);
        logarithm(relative, turn);
        times3(R, turn, drift + 3);
        for (int64_t i = 0; i < k; i++) {
            if (across(own, chosen[i], axis)) {
                e[i] = dot3(axis, drift + 3);
                angular_row(nv, axis, jacobian, J + i * nv);
                continue;
            }
            e[i] = drift[chosen[i]];
            copy_row(J + i * nv, jacobian + chosen[i] * nv, nv);
        }
        return;
    }
    case RELATIVE: { /* own: position (3), rotation (3, 3), rate (6), acceleration (6), in the other's axes */
        const double *there = frames + block->other * FRAME_SIZE(nv);
        double target[15];
        seen_target(own, there, target);
        rotation_error(target, R, all + 3, to_error);
        loop_rows(plan, block, state, 1.0, J, nv, 1, e);
        for (int64_t i = 0; i < k; i++) {
            const int64_t r = chosen[i];
            if (r < 3) {
                e[i] -= own[r], bias[i] = -own[12 + r];
                continue;
            }
            const double *T = to_error + 3 * (r - 3);
            e[i] = all[r], bias[i] = -dot3(T, target + 9);
            turn_row(nv, T, jacobian, there + FRAME_JACOBIAN, J + i * nv);
        }
        return;
    }
    case LOOP:
        loop_rows(plan, block, state, 1.0, J, nv, 1, e);
        return;
    case GEAR:
        *e = gear_row(plan, own, q, 1.0, J, 1);
        return;
    case ASKED: /* own: Jacobian (k, nv), errors (k) */
        copy_row(J, own, k * nv);
        copy_row(e, own + k * nv, k);
        return;
    default: /* LINEAR in the joints; own: matrix (k, nv), offsets (k) */
        copy_row(J, own, k * nv);
        for (int64_t i = 0; i < k; i++) {
            e[i] = -own[k * nv + i];
            for (int64_t c = 6; c < nv; c++)
                if (own[i * nv + c] != 0.0) e[i] += own[i * nv + c] * joint_position(plan, q, c - 6);
        }
        return;
    }
}

/* Second derivative of log(target' R) at zero acceleration of v: d/dt R'(w - w*) = R'(w' - w*' + w x w*). */
static void orientation_drift(const double *own, const double *R, const double *w, const double *alpha,
                              const double *e, double *out) {
    const double *rate = own + 9, *push = own + 12;
    double turn[3], spin[3], relative[3], carried[3], local[3], J[9], moving[3];
    cross3(w, rate, turn);
    for (int i = 0; i < 3; i++) {
        relative[i] = w[i] - rate[i];
        carried[i] = alpha[i] - push[i] + turn[i];
    }
    transposed_times3(R, relative, spin);
    transposed_times3(R, carried, local);
    log_jacobian(e, J);
    times3(J, spin, moving);
    times3(J, local, out);
    log_jacobian_rate_times(e, moving, spin, turn);
    for (int i = 0; i < 3; i++) out[i] += turn[i];
}

/* Second derivative of vech(I) in axes R that turn at w and alpha: inertia_drift_in of a state. */
static void inertia_drift(const double *state, const double *drifts, const double *R, const double *w,
                          const double *alpha, double *out) {
    const double *I = state + INERTIA;
    const double entries[6] = {I[0], I[1], I[2], I[4], I[5], I[8]};
    const double back[3] = {-alpha[0], -alpha[1], -alpha[2]};
    double half[6], total[6], turn[9];
    for (int i = 0; i < 6; i++) {
        half[i] = 2.0 * drifts[INERTIA_RATE + i];
        total[i] = drifts[INERTIA_CURVATURE + i];
    }
    /* total - [w, 2 I' - [w, I]] - [alpha, I], in the commutator of skew matrices */
    const double against[3] = {-w[0], -w[1], -w[2]};
    add_commutator(half, entries, against);
    add_commutator(total, half, against);
    add_commutator(total, entries, back);
    for (int i = 0; i < 9; i++) turn[i] = R[3 * (i % 3) + i / 3];
    congruent(turn, total, out);
}

void block_drift(const wbc_plan *plan, const wbc_block *block, const double *state, const double *frames,
                 const double *motion, const double *accelerations, const double *q, const double *v, const double *e,
                 double *drift) {
    const int64_t nv = plan->tree->nv, k = block->rows, *chosen = plan->index + block->index;
    const double *weight = plan->number + block->number + WEIGHTS, *own = weight + 3 * k;
    const double *drifts = motion + DRIFTS(nv), *R = 0, *acceleration = 0, *w = 0;
    double whole[6];
    copy_row(drift, weight + 2 * k, k);
    if (block->frame >= 0) {
        R = frames + block->frame * FRAME_SIZE(nv) + FRAME_ROTATION;
        acceleration = accelerations + 6 * block->frame;
        w = motion + JOINT_MOTION(nv) + JOINT_MOTION_SIZE * plan->frame_joint[block->frame] + OMEGA;
    }
    switch (block->kind) {
    case POINT:
    case CONTACT:
        if (block->frame < 0) acceleration = drifts + COM_DRIFT;
        for (int64_t i = 0; i < k; i++)
            drift[i] += across(own, chosen[i], whole) ? dot3(whole, acceleration + 3) : acceleration[chosen[i]];
        return;
    case ORIENTATION:
        orientation_drift(own, R, w, acceleration + 3, e, whole);
        for (int i = 0; i < 3; i++) drift[i] += whole[i];
        return;
    case POINTING: { /* w x (w x p) + alpha x p, p = R axis */
        double p[3], moving[3], *turned = whole, *pulled = whole + 3;
        times3(R, own + 3, p);
        cross3(w, p, moving);
        cross3(w, moving, turned);
        cross3(acceleration + 3, p, pulled);
        for (int64_t i = 0; i < k; i++) drift[i] += turned[chosen[i]] + pulled[chosen[i]];
        return;
    }
    case INERTIA_ENTRIES:
        if (block->frame < 0) copy_row(whole, drifts + INERTIA_CURVATURE, 6);
        else inertia_drift(state, drifts, R, w, acceleration + 3, whole);
        for (int64_t i = 0; i < k; i++)
            for (int j = 0; j < 6; j++) drift[i] += own[6 * i + j] * whole[j];
        return;
    case MOMENTUM_ENTRIES:
        for (int64_t i = 0; i < k; i++) drift[i] += drifts[MOMENTUM_DRIFT + chosen[i]];
        return;
    case RELATIVE: {
        const double *there = frames + block->other * FRAME_SIZE(nv), *b = accelerations + 6 * block->other;
        const double *wa = motion + JOINT_MOTION(nv) + JOINT_MOTION_SIZE * plan->frame_joint[block->other] + OMEGA;
        double target[15], turned[3], all[3], T[9];
        seen_target(own, there, target);
        rotation_error(target, R, all, T);
        cross3(wa, target + 9, turned); /* the target moves with the other frame */
        for (int i = 0; i < 3; i++) target[12 + i] += b[3 + i] + turned[i], target[9 + i] += wa[i];
        loop_drift(plan, block, state, motion, v, whole);
        orientation_drift(target, R, w, acceleration + 3, all, whole + 3);
        for (int64_t i = 0; i < k; i++) drift[i] += whole[chosen[i]] - (chosen[i] < 3 ? own[18 + chosen[i]] : 0.0);
        return;
    }
    case LOOP:
        loop_drift(plan, block, state, motion, v, whole);
        for (int64_t i = 0; i < k; i++) drift[i] += whole[chosen[i]];
        return;
    case GEAR:
        *drift += gear_drift(plan, own, q, v);
        return;
    default: /* joints are coordinates of v; an ASKED task has given the whole drift */
        return;
    }
}

int wbc_rows(const wbc_plan *plan, const double *state, const double *motion, const double *q, const double *v,
             double *out) {
    const int64_t nv = plan->tree->nv, held = plan->held;
    double *frames = plan->scratch, *accelerations = frames + plan->frames * FRAME_SIZE(nv);
    double *error = out + held * nv, *bias = error + held, *drift = bias + held, *bound = drift + held;
    *bound = 0.0;
    wbc_frames(plan->tree, state, plan->frames, plan->frame_joint, plan->frame_placement, frames);
    if (motion)
        wbc_drifts(plan->tree, state, motion, plan->frames, plan->frame_joint, plan->frame_placement, accelerations);
    for (const wbc_block *block = plan->block; block < plan->block + plan->blocks; block++) {
        const int64_t r = block->first;
        double own;
        evaluate_block(plan, block, state, frames, q, out + r * nv, error + r, bias + r, &own);
        *bound += own;
        if (motion) block_drift(plan, block, state, frames, motion, accelerations, q, v, error + r, drift + r);
    }
    return DONE;
}
