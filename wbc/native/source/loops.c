/* Closed loops and gears: errors, rows, drifts, and how far they are open where a command leads.
 *
 * In axes of the other frame of a loop, which is where its error is, joints that carry both frames move
 * nothing: their columns are exactly 0, and all that follows looks at the joints between the frames alone.
 */
#include "rows.h"
#include "tree.h"

#include <string.h>

/* Numbers of a gear: two joints, and the coefficients of its polynomial, lowest first. */
enum { FOLLOWER = 0, DRIVER = 1, POWERS = 2, GEAR_DEGREE = 4 };

/* The last joint that carries two others; parents come before children. */
static int64_t carrier(const wbc_tree *tree, int64_t i, int64_t j) {
    while (i != j)
        if (i > j)
            i = tree->parent[i];
        else
            j = tree->parent[j];
    return i;
}

static const double *place_of(const wbc_plan *plan, int64_t frame, const double *frames) {
    return frames + frame * FRAME_SIZE(plan->tree->nv);
}

/* The rows of a loop by where its frame is as seen from the other, each given by origin and rotation. */
static void gap_of(const wbc_plan *plan, const wbc_block *block, const double *one,
                   const double *other, double *gap) {
    const int64_t *chosen = plan->index + block->index;
    const double *axes = other + FRAME_ROTATION;
    double arm[3], relative[9], all[6];
    for (int i = 0; i < 3; i++) arm[i] = one[i] - other[i];
    transposed_times3(axes, arm, all);
    int turns = 0;
    for (int64_t i = 0; i < block->rows; i++) turns |= chosen[i] >= 3;
    if (turns) { /* position, then rotation vector */
        transposed_product3(axes, one + FRAME_ROTATION, relative);
        logarithm(relative, all + 3);
    }
    for (int64_t i = 0; i < block->rows; i++) gap[i] = all[chosen[i]];
}

void loop_errors(const wbc_plan *plan, const wbc_block *block, const double *frames, double *e) {
    gap_of(plan, block, place_of(plan, block->frame, frames), place_of(plan, block->other, frames), e);
}

/* Entries of a row for the joints from one up to another that carries it: u' linear + w' angular. */
static void add_columns(const wbc_plan *plan, int64_t joint, int64_t last, const double *J,
                        const double *u, const double *w, double *row, int64_t stride) {
    const wbc_tree *tree = plan->tree;
    const int64_t nv = tree->nv;
    for (int64_t j = joint; j != last; j = tree->parent[j]) {
        const int64_t first = j == 1 ? 0 : tree->iv[j], behind = j == 1 ? 6 : first + 1;
        for (int64_t c = first; c < behind; c++)
            row[c * stride] = u[0] * J[c] + u[1] * J[nv + c] + u[2] * J[2 * nv + c] +
                              w[0] * J[3 * nv + c] + w[1] * J[4 * nv + c] + w[2] * J[5 * nv + c];
    }
}

/* A row of position is u' (J - J_other) + (u x arm)' W_other with u an axis and W the angular rows, one of
 * the turn u' (W - W_other). */
void loop_row(const wbc_plan *plan, const wbc_block *block, const double *frames, int64_t i,
              double scale, double *row, int64_t stride) {
    static const double none[3] = {0.0, 0.0, 0.0};
    const int64_t nv = plan->tree->nv, chosen = plan->index[block->index + i], axis = chosen % 3;
    const int64_t joint = plan->frame_joint[block->frame], held = plan->frame_joint[block->other];
    const int64_t both = carrier(plan->tree, joint, held);
    const double *frame = place_of(plan, block->frame, frames);
    const double *there = place_of(plan, block->other, frames), *R = there + FRAME_ROTATION;
    const double u[3] = {scale * R[axis], scale * R[3 + axis], scale * R[6 + axis]};
    const double back[3] = {-u[0], -u[1], -u[2]};
    double arm[3], moved[3];
    for (int64_t c = 0; c < nv; c++) row[c * stride] = 0.0;
    if (chosen >= 3) {
        add_columns(plan, joint, both, frame + FRAME_JACOBIAN, none, u, row, stride);
        add_columns(plan, held, both, there + FRAME_JACOBIAN, none, back, row, stride);
        return;
    }
    for (int j = 0; j < 3; j++) arm[j] = frame[j] - there[j];
    cross3(u, arm, moved);
    add_columns(plan, joint, both, frame + FRAME_JACOBIAN, u, none, row, stride);
    add_columns(plan, held, both, there + FRAME_JACOBIAN, back, moved, row, stride);
}

/* Of Ra' (pb - pa) and, for the turn, of its rate Ra' (wb - wa). */
void loop_drift(const wbc_plan *plan, const wbc_block *block, const double *frames,
                const double *motion, const double *accelerations, const double *v, double *out) {
    const int64_t nv = plan->tree->nv;
    const double *frame = place_of(plan, block->frame, frames), *J = frame + FRAME_JACOBIAN;
    const double *there = place_of(plan, block->other, frames), *back = there + FRAME_JACOBIAN;
    const double *a = accelerations + 6 * block->frame, *b = accelerations + 6 * block->other;
    const double *moving = motion + JOINT_MOTION(nv);
    const double *w = moving + JOINT_MOTION_SIZE * plan->frame_joint[block->frame] + OMEGA;
    const double *wa = moving + JOINT_MOTION_SIZE * plan->frame_joint[block->other] + OMEGA;
    double arm[3], slide[3], all[6], one[3], two[3];
    for (int i = 0; i < 3; i++) {
        arm[i] = frame[i] - there[i];
        slide[i] = dot(nv, J + i * nv, v) - dot(nv, back + i * nv, v);
        all[i] = a[i] - b[i], all[3 + i] = a[3 + i] - b[3 + i];
    }
    cross3(b + 3, arm, one);
    for (int i = 0; i < 3; i++) all[i] -= one[i];
    cross3(wa, arm, one);
    for (int i = 0; i < 3; i++) one[i] -= 2.0 * slide[i];
    cross3(wa, one, two);
    cross3(wa, w, one);
    for (int i = 0; i < 3; i++) all[i] += two[i], all[3 + i] -= one[i];
    transposed_times3(there + FRAME_ROTATION, all, out);
    transposed_times3(there + FRAME_ROTATION, all + 3, out + 3);
}

/* A gear's polynomial at its driver's position, and its derivatives. */
static void polynomial(const double *gear, double x, double *value) {
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
    polynomial(gear, joint_position(plan, q, driver), by);
    for (int64_t c = 0; c < plan->tree->nv; c++) row[c * stride] = 0.0;
    row[(6 + follower) * stride] = scale, row[(6 + driver) * stride] = -scale * by[1];
    return joint_position(plan, q, follower) - by[0];
}

double gear_drift(const wbc_plan *plan, const double *gear, const double *q, const double *v) {
    const int64_t driver = joint_of(gear, DRIVER);
    double by[3];
    polynomial(gear, joint_position(plan, q, driver), by);
    return -by[2] * v[6 + driver] * v[6 + driver];
}

static double gear_gap(const wbc_plan *plan, const double *gear, const double *q, const double *v) {
    const int64_t follower = joint_of(gear, FOLLOWER), driver = joint_of(gear, DRIVER);
    double by[3];
    polynomial(gear, joint_position(plan, q, driver) + plan->dt * v[6 + driver], by);
    return joint_position(plan, q, follower) + plan->dt * v[6 + follower] - by[0];
}

/* Origin and rotation (12) of a frame in a joint that carries it, once all have moved by v dt. */
static void moved_frame(const wbc_plan *plan, int64_t frame, int64_t carrying, const double *q,
                        const double *v, double *pose) {
    const wbc_tree *tree = plan->tree;
    const double *placement = plan->frame_placement + 12 * frame;
    double *p = pose, *R = pose + FRAME_ROTATION;
    memcpy(R, placement, 9 * sizeof *R);
    memcpy(p, placement + 9, 3 * sizeof *p);
    for (int64_t j = plan->frame_joint[frame]; j != carrying; j = tree->parent[j]) {
        double there[12], turned[9], arm[3];
        moved_joint(tree, j, q, v, plan->dt, there);
        product3(there, R, turned);
        times3(there, p, arm);
        memcpy(R, turned, sizeof turned);
        for (int i = 0; i < 3; i++) p[i] = there[9 + i] + arm[i];
    }
}

static void loop_gaps(const wbc_plan *plan, const wbc_block *block, const double *q,
                      const double *v, double *gaps) {
    const int64_t both =
        carrier(plan->tree, plan->frame_joint[block->frame], plan->frame_joint[block->other]);
    double one[12], other[12];
    moved_frame(plan, block->frame, both, q, v, one);
    moved_frame(plan, block->other, both, q, v, other);
    gap_of(plan, block, one, other, gaps);
}

static int bends(const double *gear) {
    return gear[POWERS + 2] != 0.0 || gear[POWERS + 3] != 0.0 || gear[POWERS + 4] != 0.0;
}

int64_t wbc_gaps(const wbc_plan *plan, const double *q, const double *v, double *gaps) {
    int64_t bent = 0;
    memset(gaps, 0, plan->held * sizeof *gaps);
    for (const wbc_block *block = plan->block; block < plan->block + plan->blocks; block++) {
        const double *own = plan->number + block->number + WEIGHTS + 3 * block->rows;
        double *to = gaps + block->first;
        if (block->held && block->kind == LOOP)
            loop_gaps(plan, block, q, v, to), bent += block->rows;
        else if (block->held && block->kind == GEAR && bends(own))
            *to = gear_gap(plan, own, q, v), bent++;
    }
    return bent;
}
