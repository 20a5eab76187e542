/* Closed loops and gears: errors, rows, drifts, and the gaps where a command leads.
 *
 * A loop's error is that of one frame in axes of the other. Joints that carry both frames do not change it:
 * their columns are exactly 0, and only the joints between the frames are visited. The frames need no
 * Jacobians: those used by loops only are behind plan->frames.
 */
#include "rotation.h"
#include "rows.h"
#include "tree.h"

#include <string.h>

/* Numbers of a gear: two joints, and the coefficients of its polynomial, lowest first. */
enum { FOLLOWER = 0, DRIVER = 1, POWERS = 2, GEAR_DEGREE = 4 };

/* The joints that carry one end of a loop but not the other: from one, inwards, to (but not including) another. */
typedef struct {
    int64_t from, to;
} chain;

static chain chain_of(const wbc_plan *plan, const wbc_block *block, int side) {
    const int64_t *parent = plan->tree->parent, one = plan->frame_joint[block->frame];
    const int64_t other = plan->frame_joint[block->other];
    int64_t i = one, j = other;
    while (i != j) /* parents come before children */
        if (i > j) i = parent[i];
        else j = parent[j];
    const chain found = {side ? other : one, i};
    return found;
}

/* A loop's ends in the world: pose (12) of its frame, with rotation only if that is held, too, and of the frame
 * that holds it. */
typedef struct {
    double one[12], other[12];
    int turns;
} loop_ends;

static void place_ends(const wbc_plan *plan, const wbc_block *block, const double *state, loop_ends *ends) {
    ends->turns = 0;
    for (int64_t i = 0; i < block->rows; i++) ends->turns |= plan->index[block->index + i] >= 3;
    place_frame(plan->tree, state, plan->frame_joint[block->frame], plan->frame_placement + 12 * block->frame,
                ends->turns, ends->one);
    place_frame(plan->tree, state, plan->frame_joint[block->other], plan->frame_placement + 12 * block->other, 1,
                ends->other);
}

/* Write the rows' errors: the pose of the frame in the other one. */
static void gap_of(const wbc_plan *plan, const wbc_block *block, const loop_ends *ends, double *gap) {
    const int64_t *chosen = plan->index + block->index;
    const double *axes = ends->other + FRAME_ROTATION;
    double arm[3], relative[9], all[6];
    for (int i = 0; i < 3; i++) arm[i] = ends->one[i] - ends->other[i];
    transposed_times3(axes, arm, all);
    if (ends->turns) { /* position, then rotation vector */
        transposed_product3(axes, ends->one + FRAME_ROTATION, relative);
        logarithm(relative, all + 3);
    }
    for (int64_t i = 0; i < block->rows; i++) gap[i] = all[chosen[i]];
}

/* The joints on either side move the frame's origin, in the other frame's axes. */
void loop_rows(const wbc_plan *plan, const wbc_block *block, const double *state, double scale, double *rows,
               int64_t apart, int64_t stride, double *errors) {
    const wbc_tree *tree = plan->tree;
    const int64_t nv = tree->nv, k = block->rows, *chosen = plan->index + block->index;
    const double *T = state + TWISTS(nv);
    const chain sides[2] = {chain_of(plan, block, 0), chain_of(plan, block, 1)};
    double u[3], all[6];
    loop_ends ends;
    place_ends(plan, block, state, &ends);
    if (errors) gap_of(plan, block, &ends, errors);
    for (int64_t i = 0; i < k; i++)
        for (int64_t c = 0; c < nv; c++) rows[i * apart + c * stride] = 0.0;
    for (int side = 0; side < 2; side++, scale = -scale)
        for (int64_t j = sides[side].from; j != sides[side].to; j = tree->parent[j]) {
            const int64_t c = tree->iv[j];
            const double w[3] = {T[3 * nv + c], T[4 * nv + c], T[5 * nv + c]};
            speed_at(tree, state, j, c, ends.one, u);
            transposed_times3(ends.other + FRAME_ROTATION, u, all);
            if (ends.turns) transposed_times3(ends.other + FRAME_ROTATION, w, all + 3);
            for (int64_t i = 0; i < k; i++) rows[i * apart + c * stride] = scale * all[chosen[i]];
        }
}

/* Drift of Ra' (pb - pa): a' - w' x arm - w x (w x arm) - 2 w x (velocity in axes of a); and of Ra' (wb - wa). */
void loop_drift(const wbc_plan *plan, const wbc_block *block, const double *state, const double *motion,
                const double *v, double *out) {
    const wbc_tree *tree = plan->tree;
    const int64_t frames[2] = {block->frame, block->other};
    const double *moving = motion + JOINT_MOTION(tree->nv);
    const double *w = moving + JOINT_MOTION_SIZE * plan->frame_joint[block->frame] + OMEGA;
    const double *wa = moving + JOINT_MOTION_SIZE * plan->frame_joint[block->other] + OMEGA;
    double a[12], rate[3] = {0.0, 0.0, 0.0}, arm[3], turn[3], u[3], all[6];
    loop_ends ends;
    place_ends(plan, block, state, &ends);
    for (int side = 0; side < 2; side++) {
        const chain along = chain_of(plan, block, side);
        wbc_drifts(tree, state, motion, 1, plan->frame_joint + frames[side],
                   plan->frame_placement + 12 * frames[side], a + 6 * side);
        for (int64_t j = along.from; j != along.to; j = tree->parent[j]) {
            const double by = v[tree->iv[j]];
            speed_at(tree, state, j, tree->iv[j], ends.one, u);
            for (int i = 0; i < 3; i++) rate[i] += (side ? -by : by) * u[i];
        }
    }
    for (int i = 0; i < 6; i++) all[i] = a[i] - a[6 + i];
    for (int i = 0; i < 3; i++) arm[i] = ends.one[i] - ends.other[i];
    cross3(a + 9, arm, turn);
    for (int i = 0; i < 3; i++) all[i] -= turn[i];
    cross3(wa, arm, turn);
    for (int i = 0; i < 3; i++) turn[i] += 2.0 * rate[i];
    cross3(wa, turn, u);
    cross3(wa, w, turn);
    for (int i = 0; i < 3; i++) all[i] -= u[i], all[3 + i] -= turn[i];
    transposed_times3(ends.other + FRAME_ROTATION, all, out);
    transposed_times3(ends.other + FRAME_ROTATION, all + 3, out + 3);
}

/* A gear's polynomial at its driver's position, and its derivatives. */
static void gear_polynomial(const double *gear, double x, double *value) {
    value[0] = value[1] = value[2] = 0.0;
    for (int k = GEAR_DEGREE; k >= 0; k--) {
        value[2] = value[2] * x + 2.0 * value[1];
        value[1] = value[1] * x + value[0];
        value[0] = value[0] * x + gear[POWERS + k];
    }
}

static int64_t joint_of(const double *gear, int which) { return (int64_t)gear[which]; }

double gear_row(const wbc_plan *plan, const double *gear, const double *q, double scale, double *row,
                int64_t stride) {
    const int64_t follower = joint_of(gear, FOLLOWER), driver = joint_of(gear, DRIVER);
    double by[3];
    gear_polynomial(gear, joint_position(plan, q, driver), by);
    for (int64_t c = 0; c < plan->tree->nv; c++) row[c * stride] = 0.0;
    row[(6 + follower) * stride] = scale, row[(6 + driver) * stride] = -scale * by[1];
    return joint_position(plan, q, follower) - by[0];
}

double gear_drift(const wbc_plan *plan, const double *gear, const double *q, const double *v) {
    const int64_t driver = joint_of(gear, DRIVER);
    double by[3];
    gear_polynomial(gear, joint_position(plan, q, driver), by);
    return -by[2] * v[6 + driver] * v[6 + driver];
}

static double gear_gap(const wbc_plan *plan, const double *gear, const double *q, const double *v) {
    const int64_t follower = joint_of(gear, FOLLOWER), driver = joint_of(gear, DRIVER);
    double by[3];
    gear_polynomial(gear, joint_position(plan, q, driver) + plan->dt * v[6 + driver], by);
    return joint_position(plan, q, follower) + plan->dt * v[6 + follower] - by[0];
}

/* Move a frame by a joint's twist for some time: joints need not be placed again. */
static void move_frame(const wbc_tree *tree, int64_t j, const double *state, const double *v, double time, int turns,
                       double *pose) {
    const int64_t nv = tree->nv, c = tree->iv[j];
    const double *T = state + TWISTS(nv) + c, by = time * v[c];
    const double w[3] = {by * T[3 * nv], by * T[4 * nv], by * T[5 * nv]};
    double u[3], turn[3], again[3], k[4];
    coefficients(w, k);
    speed_at(tree, state, j, c, pose, u);
    cross3(w, u, turn);
    for (int i = 0; i < 3; i++) pose[i] += by * (k[0] * u[i] + k[1] * turn[i]);
    for (int a = 0; a < 3 && turns; a++) { /* column by column */
        double *R = pose + FRAME_ROTATION + a;
        const double axis[3] = {R[0], R[3], R[6]};
        cross3(w, axis, turn);
        cross3(w, turn, again);
        for (int i = 0; i < 3; i++) R[3 * i] += k[0] * turn[i] + k[1] * again[i];
    }
}

/* Backwards along the joints from another one, which comes first. */
static void move_back(const wbc_plan *plan, int64_t joint, int64_t to, const double *state, const double *v,
                      loop_ends *ends) {
    if (joint == to) return;
    move_back(plan, plan->tree->parent[joint], to, state, v, ends);
    move_frame(plan->tree, joint, state, v, -plan->dt, ends->turns, ends->one);
}

/* The gap where the command leads: the frame moved forwards by its own joints, backwards by the other side's. */
static void loop_gaps(const wbc_plan *plan, const wbc_block *block, const double *state, const double *v,
                      double *gaps) {
    const chain own = chain_of(plan, block, 0), held = chain_of(plan, block, 1);
    loop_ends ends;
    place_ends(plan, block, state, &ends);
    for (int64_t j = own.from; j != own.to; j = plan->tree->parent[j])
        move_frame(plan->tree, j, state, v, plan->dt, ends.turns, ends.one);
    move_back(plan, held.from, held.to, state, v, &ends);
    gap_of(plan, block, &ends, gaps);
}

static int is_nonlinear(const double *gear) {
    return gear[POWERS + 2] != 0.0 || gear[POWERS + 3] != 0.0 || gear[POWERS + 4] != 0.0;
}

int wbc_gaps(const wbc_plan *plan, const double *state, const double *q, const double *v, double *gaps) {
    memset(gaps, 0, plan->held * sizeof *gaps);
    for (const wbc_block *block = plan->block; block < plan->block + plan->blocks; block++) {
        const double *own = plan->number + block->number + WEIGHTS + 3 * block->rows;
        double *to = gaps + block->first;
        if (block->held && block->kind == LOOP) loop_gaps(plan, block, state, v, to);
        else if (block->held && block->kind == GEAR && is_nonlinear(own)) *to = gear_gap(plan, own, q, v);
    }
    return DONE;
}
