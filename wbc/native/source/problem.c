/* The QP of a tick's first level: the rows of tasks and contacts by the laws of both control levels, the
 * box of the limits, inequality rows, and at the torque level dynamics, torque bounds and cones. Other
 * levels: levels.c.
 */
#include "problem.h"
#include "margin.h"
#include "rows.h"
#include "tree.h"

#include <string.h>

/* A joint this little outside its limit [rad or m] counts as at it: rounding must not decide whether a cost that
 * outweighs all tasks appears. FAR stands for no limit. */
static const double AT_LIMIT = 1e-9, FAR = 1e12;
/* BRAKING: largest deceleration that limits demand, by the one they count on; the rest is a reserve. Joints
 * approach limits as exp(-t / ARRIVAL) [s], and excess speed decays as exp(-t / SETTLE). */
static const double BRAKING = 2.0, ARRIVAL = 0.02, SETTLE = 0.02;
/* Recovery outweighs the tasks by this squared factor; the heaviest task counts as IDLE at least. */
static const double RECOVERY_FACTOR = 1e4, IDLE = 1e-6;
static const double SHORT_LEVER = 0.05; /* m: joints recover little by shorter ones, which would take any speed */
const double wbc_largest_qp = 1e150;

void lay_out(const wbc_plan *plan, wbc_qp *qp) {
    const int64_t nv = plan->tree->nv, n = nv + plan->forces, k = plan->passives + plan->held;
    const int64_t m = plan->bounded + plan->cones + margin_rows(plan) + plan->given_rows;
    const int64_t D = plan->torque ? nv : 0;
    double *at = plan->out;
    qp->n = n, qp->k = k, qp->m = m, qp->wide = plan->wide, qp->eps = plan->eps;
    qp->P = at, at += n * n;
    qp->A = at, at += k * n;
    qp->C = at, at += m * n;
    qp->D = at, at += D * n;
    qp->offset = at, at += D;
    qp->g = at, at += n;
    qp->lower = at, at += n;
    qp->upper = at, at += n;
    qp->b = at, at += k;
    qp->l = at, at += m;
    qp->u = at, at += m;
    qp->errors = at, at += plan->costs;
    qp->heaviest = at, at += 1;
    qp->x = at, at += n;
    qp->y = at, at += k;
    qp->z = at, at += m;
    qp->z_box = at, at += n;
    qp->found = at, at += 5;
    qp->exact = at, at += plan->torque ? nv : 0;
    qp->torque = at, at += plan->torque ? nv - 6 : 0;
    qp->clearance = at, at += margin_rows(plan);
    qp->chosen = at;
}

WIDE void add_squares(int64_t nv, int64_t rows, const double *restrict J, const double *wanted, double *restrict P,
                      int64_t n, double *restrict g) {
    for (int64_t r = 0; r < rows; r += 3) {
        const double *a = J + r * nv, *b = r + 1 < rows ? a + nv : 0, *c = r + 2 < rows ? b + nv : 0;
        if (c) {
            for (int64_t i = 0; i < nv; i++) {
                const double x = a[i], y = b[i], z = c[i];
                if (fabs(x) + fabs(y) + fabs(z) == 0.0) continue;
                double *restrict to = P + i * n;
                int64_t j = nv - PADDED(nv - i); /* up to three unused entries, and no remainder */
                if (j < 0) j = i;
                for (; j + 4 <= nv; j += 4) *(four *)(to + j) += x * FOUR(a + j) + y * FOUR(b + j) + z * FOUR(c + j);
                for (; j < nv; j++) to[j] += x * a[j] + y * b[j] + z * c[j];
                g[i] -= wanted[r] * x + wanted[r + 1] * y + wanted[r + 2] * z;
            }
        } else {
            for (int64_t s = r; s < rows; s++) {
                const double *one = J + s * nv;
                for (int64_t i = 0; i < nv; i++) {
                    if (one[i] == 0.0) continue;
                    for (int64_t j = i; j < nv; j++) P[i * n + j] += one[i] * one[j];
                    g[i] -= wanted[s] * one[i];
                }
            }
        }
    }
}

/* The stopping distance from a speed: most joints are farther from their limits. */
static double stopping_distance_from(double speed, double deceleration, double wait) {
    return speed * (wait + 0.5 * speed / deceleration);
}

/* The speed from which a joint stops within a distance; from outside, the speed back. */
static double braking_speed(double distance, double most, double deceleration, double wait) {
    const double inside = distance > 0.0 ? distance : 0.0;
    double speed = stopping_speed(inside, deceleration, wait) + (distance - inside) / wait;
    if (speed < -most) speed = -most;
    return speed > most ? most : speed;
}

/* The bound on the speed towards a limit at the torque level, so that joints arrive without chatter: u(x - v dt) +
 * (1 - dt / S) (v - u(x)), where a joint at the speed u(x) stops within x. At u(x) it stays there, excess speed
 * decays with the time constant S, and outside the joint comes back with T: one law, without a switch. */
static double arrival_bound(double distance, double towards, double speed, double faster, double deceleration,
                            double dt) {
    const double wait = ARRIVAL > dt ? ARRIVAL : dt, left = distance > FAR ? FAR : distance;
    const double kept = SETTLE > dt ? 1.0 - dt / SETTLE : 0.0;
    const double now = braking_speed(left, speed, deceleration, wait);
    double most = braking_speed(left - dt * towards, speed, deceleration, wait);
    most += kept * (towards - now);
    if (most > speed || left >= FAR) most = speed;
    if (most > faster) most = faster;
    const double reach = towards - BRAKING * dt * deceleration;
    return most < reach ? reach : most;
}

/* The squared weight of a cost that outweighs the tasks. */
static double dominating_weight(const wbc_qp *qp) {
    return RECOVERY_FACTOR * (*qp->heaviest > IDLE ? *qp->heaviest : IDLE);
}

/* What is violated asks its row, or a joint (row 0), for at least a rate in a direction. */
typedef struct {
    const double *row;
    int64_t joint;
    double direction, rate, weight;
} recovery;

/* Writes the recovery k of all: margins between bodies, those given by Python, joints outside. 0: nothing to do. */
static int find_recovery(const wbc_plan *plan, const double *q, const double *v, const wbc_qp *qp, int64_t k,
                         recovery *found) {
    const int64_t nv = plan->tree->nv, between = margin_rows(plan), joint = k - between - plan->pushes;
    found->joint = 0, found->direction = found->weight = 1.0;
    if (k < between) return recovers_margin(plan, v, qp, k, &found->row, &found->rate);
    if (joint < 0) {
        const double *target = plan->push + plan->pushes * nv + k - between;
        found->row = plan->push + (k - between) * nv, found->rate = target[0], found->weight = target[plan->pushes];
        return 1;
    }
    const double *lo = plan->limit, *up = lo + nv - 6, *speed = up + nv - 6;
    const double position = joint_position(plan, q, joint);
    const double below = lo[joint] - position, above = position - up[joint], outside = above > below ? above : below;
    const double rate = plan->recovery / plan->dt * outside;
    found->row = 0, found->joint = joint, found->direction = above > below ? -1.0 : 1.0;
    found->rate = rate > speed[joint] ? speed[joint] : rate;
    return outside > AT_LIMIT;
}

/* Over the joints: whether contacts let the base move is not known here. */
static double product(int64_t nv, const recovery *a, const recovery *b) {
    if (a->row && b->row) return dot(nv - 6, a->row + 6, b->row + 6);
    if (a->row) return b->direction * a->row[6 + b->joint];
    return b->row ? a->direction * b->row[6 + a->joint] : a->joint == b->joint;
}

/* Costs that outweigh the tasks. Where the joints that recover one violation move another one faster than it asks
 * for, it asks for that, so that the slower does not hold the faster back; but rows for no more than the other one's
 * own rate, or long levers would be thrown by short ones. */
void recover(const wbc_plan *plan, const double *q, const double *v, const wbc_qp *qp) {
    const int64_t nv = plan->tree->nv, n = qp->n, joints = plan->limited && !plan->torque ? nv - 6 : 0;
    const int64_t all = margin_rows(plan) + plan->pushes + joints;
    for (int64_t k = 0; k < all; k++) {
        recovery own, other;
        if (!find_recovery(plan, q, v, qp, k, &own)) continue;
        double rate = own.rate;
        for (int64_t l = 0; l < all; l++) {
            if (l == k || !find_recovery(plan, q, v, qp, l, &other) || other.rate <= 0.0) continue;
            const double shared = other.rate * product(nv, &own, &other);
            const double of_own = own.row && other.row ? product(nv, &own, &own) : 0.0;
            double lever = product(nv, &other, &other) + SHORT_LEVER * SHORT_LEVER;
            if (of_own > lever) lever = of_own;
            if (shared > rate * lever) rate = shared / lever;
        }
        const double size = dominating_weight(qp) * own.weight * own.weight;
        if (!own.row) {
            qp->P[(6 + own.joint) * (n + 1)] += size;
            qp->g[6 + own.joint] -= size * own.direction * rate;
        }
        for (int64_t i = 0; own.row && i < nv; i++) {
            if (own.row[i] == 0.0) continue;
            for (int64_t j = i; j < nv; j++) qp->P[i * n + j] += size * own.row[i] * own.row[j];
            qp->g[i] -= size * rate * own.row[i];
        }
    }
}

/* The box on v+ of wbc.constraints.Limits: speeds from which a joint still stops, and accelerations (of braking,
 * too, if that is bounded); at the torque level the law of arrival. */
static void limits_box(const wbc_plan *plan, const double *q, const double *v, double *lower, double *upper) {
    const int64_t n = plan->tree->nv - 6;
    const double *lo = plan->limit, *up = lo + n, *speed = up + n, *rise = speed + n;
    const double dt = plan->dt, *braked = rise + n, *base = braked + n;
    for (int i = 0; i < 6; i++) lower[i] = base[i], upper[i] = base[6 + i];
    for (int64_t k = 0; k < n; k++) {
        const double position = joint_position(plan, q, k), start = rise[k] * dt;
        const double left[2] = {position - lo[k], up[k] - position};
        double most[2];
        for (int side = 0; side < 2; side++) {
            const double towards = side ? v[6 + k] : -v[6 + k];
            if (plan->torque) {
                const double now = plan->braked || towards > 0.0 ? towards : 0.0;
                most[side] = arrival_bound(left[side], towards, speed[k], now + start, braked[k], dt);
                continue;
            }
            most[side] = speed[k];
            const double change = towards + start;
            if (!plan->braked) { /* it may stop and reverse within one tick */
                const double limit = change > start ? change : start;
                if (most[side] > limit) most[side] = limit;
            }
            const double reach = left[side] < 0.0 ? 0.0 : left[side];
            /* Without limits on speed and acceleration the stopping distance is NaN. */
            if (left[side] <= FAR && !(reach >= stopping_distance_from(most[side], braked[k], dt))) {
                const double slowed = stopping_speed(reach, braked[k], dt);
                if (most[side] > slowed) most[side] = slowed;
            }
        }
        if (plan->braked && !plan->torque) { /* the acceleration limits win where the position limits demand harder
                                              * braking */
            const double other[2] = {-most[1], -most[0]};
            for (int side = 0; side < 2; side++) {
                const double towards = side ? v[6 + k] : -v[6 + k];
                const double change = towards + (towards > 0.0 ? start : braked[k] * dt);
                if (most[side] > change) most[side] = change;
                if (most[side] < other[side]) most[side] = other[side];
            }
        }
        if (plan->torque && most[0] + most[1] < 0.0) { /* they contradict each other: take the middle */
            const double between = 0.5 * (most[1] - most[0]);
            most[0] = -between, most[1] = between;
        }
        lower[6 + k] = -most[0], upper[6 + k] = most[1];
    }
}

int wbc_box(const wbc_plan *plan, const double *q, const double *v, double *box) {
    limits_box(plan, q, v, box, box + plan->tree->nv);
    return DONE;
}

/* The contact forces' part of the dynamics: the columns of D behind v+, negative. */
static void add_forces(const wbc_plan *plan, const double *state, const double *frames, const double *q,
                       const wbc_qp *qp) {
    const int64_t nv = plan->tree->nv, n = nv + plan->forces;
    double *D = qp->D;
    for (const wbc_force *force = plan->force; force < plan->force + plan->bearing; force++) {
        const wbc_block *block = plan->block + force->block;
        const double *frame = frames + block->frame * FRAME_SIZE(nv), *R = frame + FRAME_ROTATION;
        const double *J = frame + FRAME_JACOBIAN, *corner = plan->corner + force->corner;
        static const double world[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
        const double *axes = force->aligned ? world : R;
        double *to = D + nv + force->column;
        if (block->kind == LOOP && block->held && block->rows == force->count) { /* the rows are already there */
            const double *A = qp->A + (plan->passives + block->first) * n;
            for (int64_t r = 0; r < force->count; r++)
                for (int64_t i = 0; i < nv; i++)
                    if (A[r * n + i] != 0.0) to[i * n + r] = -A[r * n + i]; /* they are sparse */
            continue;
        }
        if (block->kind == LOOP) {
            loop_rows(plan, block, state, -1.0, to, 1, n, 0);
            continue;
        }
        if (block->kind == GEAR) {
            gear_row(plan, plan->number + block->number + WEIGHTS + 3, q, -1.0, to, n);
            continue;
        }
        if (force->corners == 0) { /* along the contact's own rows */
            const double *own = plan->number + block->number + WEIGHTS + 3 * block->rows;
            const double *rows = block->frame < 0 ? own : J;
            for (int64_t r = 0; r < force->count; r++)
                for (int64_t i = 0; i < nv; i++) to[i * n + r] = -rows[r * nv + i];
            continue;
        }
        for (int64_t j = plan->frame_joint[block->frame], i; j > 0; j = plan->tree->parent[j])
            for (int64_t behind = columns_of(plan->tree, j, &i); i < behind; i++) { /* the columns that move the
                                                                                     * frame */
                const double w[3] = {J[3 * nv + i], J[4 * nv + i], J[5 * nv + i]};
                for (int64_t c = 0; c < force->corners; c++) {
                    double arm[3], u[3], along[3];
                    times3(axes, corner + 3 * c, arm);
                    cross3(w, arm, u);
                    for (int r = 0; r < 3; r++) u[r] += J[r * nv + i];
                    transposed_times3(axes, u, along);
                    for (int r = 0; r < 3; r++) to[i * n + 3 * c + r] = -along[r];
                }
            }
    }
}

/* The dynamics, base forces and torques D x + offset, and the rows made of them, behind those of loops. */
static void add_dynamics(const wbc_plan *plan, const double *state, const double *frames, const double *motion,
                         const double *q, const double *v, const wbc_qp *qp) {
    const int64_t nv = plan->tree->nv, n = qp->n, f = plan->forces;
    const double *cone = plan->cone, *least = cone + plan->cones * f, *most = least + plan->cones;
    const double by_mass = 1.0 / plan->mass;
    for (int64_t i = 0; i < nv; i++) {
        double *row = qp->D + i * n;
        for (int64_t c = 0; c < nv; c++) row[c] = motion[i * nv + c] * by_mass;
        for (int64_t c = nv; c < n; c++) row[c] = 0.0;
        qp->offset[i] = (motion[BIAS(nv) + i] - plan->load[i]) / plan->unit - dot(nv, row, v);
        if (i >= 6) row[i] += plan->joint_damping[i - 6] / plan->unit;
    }
    add_forces(plan, state, frames, q, qp);
    for (int64_t r = 0; r < plan->passives; r++) {
        memcpy(qp->A + r * n, qp->D + plan->passive[r] * n, n * sizeof *qp->A);
        qp->b[r] = -qp->offset[plan->passive[r]];
    }
    for (int64_t r = 0; r < plan->bounded; r++) {
        const double known = qp->offset[plan->with_bound[r]];
        memcpy(qp->C + r * n, qp->D + plan->with_bound[r] * n, n * sizeof *qp->C);
        qp->l[r] = -plan->torque_bound[r] - known, qp->u[r] = plan->torque_bound[r] - known;
    }
    for (int64_t r = 0; r < plan->cones; r++) {
        double *row = qp->C + (plan->bounded + r) * n;
        memset(row, 0, nv * sizeof *row);
        memcpy(row + nv, cone + r * f, f * sizeof *row);
        qp->l[plan->bounded + r] = least[r], qp->u[plan->bounded + r] = most[r];
    }
    if (f == 0) return; /* no force bounds */
    memcpy(qp->lower + nv, plan->force_bound, f * sizeof *qp->lower);
    memcpy(qp->upper + nv, plan->force_bound + f, f * sizeof *qp->upper);
}

/* The rate that a row should have, by the laws of both levels. */
static double wanted_rate(const wbc_plan *plan, const double *number, double error, double bias, double drift,
                          double moving) {
    if (!plan->torque) return -number[RATE] * error - bias;
    return moving + plan->dt * (-number[STIFFNESS] * error - number[DAMPING] * (moving + bias) - drift);
}

/* Damping of the step by the block: neglected curvature, and errors (Levenberg-Marquardt). */
static void add_damping(const wbc_plan *plan, const wbc_block *block, const wbc_state_at *at, const double *error,
                        double curved, double *work, const wbc_qp *qp, double *damping) {
    const int64_t nv = plan->tree->nv, k = block->rows;
    const double *number = plan->number + block->number, *weight = number + WEIGHTS;
    double own = number[HALF_GAIN] * curved;
    const wbc_costs stored = stored_costs(plan);
    double *diagonal = plan->rows ? stored.damping + block->level * nv : qp->P;
    const int64_t stride = plan->rows ? 1 : qp->n + 1;
    const double *asked = weight + 3 * k + k * nv + k; /* of ASKED: bound (nv), curvature (nv, nv) */
    if (block->kind == INERTIA_ENTRIES && block->second)
        add_curvature(plan, block, at->state, at->frames, error, work, stored.curvature + block->level * nv * nv);
    else if (block->kind == INERTIA_ENTRIES && number[HALF_GAIN] > 0.0)
        damp_by_curvature(plan, block, at->state, at->frames, error, number[HALF_GAIN], work, diagonal, stride);
    else if (block->kind == ASKED) {
        double *H = stored.curvature + block->level * nv * nv;
        for (int64_t i = 0; i < nv; i++) diagonal[i * stride] += number[HALF_GAIN] * asked[i];
        for (int64_t i = 0; block->second && i < nv * nv; i++) H[i] += asked[nv + i];
    }
    if (number[LM_DAMPING] > 0.0) {
        double sum = 0.0;
        for (int64_t i = 0; i < k; i++) sum += weight[i] * error[i] * weight[i] * error[i];
        own += number[LM_DAMPING] * sqrt(sum);
    }
    if (plan->rows)
        for (int64_t c = 0; c < nv; c++) stored.damping[block->level * nv + c] += own;
    else *damping += own;
}

/* Store a row: of a contact as an equality, of a cost for all levels. */
static void store_row(const wbc_plan *plan, const wbc_block *block, int64_t i, const double *row, double rate,
                      double bias, const wbc_qp *qp) {
    const int64_t nv = plan->tree->nv, n = qp->n, r = block->first + i;
    const wbc_costs stored = stored_costs(plan);
    double *to = block->held ? qp->A + (plan->passives + r) * n : stored.matrix + r * n;
    if (block->kind == JOINTS && !block->held)
        memset(to, 0, nv * sizeof *to), to[6 + plan->index[block->index + i]] = 1.0;
    else if (to != row) memcpy(to, row, nv * sizeof *to);
    memset(to + nv, 0, (n - nv) * sizeof *to);
    if (block->held) qp->b[plan->passives + r] = rate;
    else stored.target[r] = rate, stored.bias[r] = bias;
}

/* Add a block to the costs or to the equalities, its damping to damping; heaviest is the largest square of a
 * weighted row. */
WIDE static void add_block(const wbc_plan *plan, const wbc_block *block, const wbc_state_at *at, double *J,
                           const wbc_qp *qp, double *damping) {
    const int64_t nv = plan->tree->nv, n = qp->n, k = block->rows;
    const double *number = plan->number + block->number, *weight = number + WEIGHTS;
    double *e = J + k * nv, *bias = e + k, *drift = bias + k, *wanted = drift + k, curved;
    double *error = block->held ? e : qp->errors + block->first;
    /* written in place if the strides agree */
    double *rows = block->held && n == nv ? qp->A + (plan->passives + block->first) * n : J;
    const int is_diagonal = block->kind == JOINTS && !block->held;
    const int is_rate = block->kind == MOMENTUM_ENTRIES && !block->held;
    evaluate_block(plan, block, at->state, at->frames, at->q, rows, error, bias, &curved);
    for (int64_t i = 0; i < k && (block->kind == LOOP || block->kind == GEAR); i++)
        error[i] += plan->added[block->first + i];
    if (plan->torque)
        block_drift(plan, block, at->state, at->frames, at->motion, at->accelerations, at->q, at->v, error, drift);
    else {
        memset(drift, 0, k * sizeof *drift);
        if (!block->held) add_damping(plan, block, at, error, curved, wanted + k, qp, damping);
    }
    for (int64_t i = 0; i < k; i++) {
        const int64_t c = 6 + plan->index[block->index + i];
        double *row = rows + i * nv, moving = 0.0, size = weight[i] * weight[i];
        if (plan->torque || is_rate) moving = is_diagonal ? at->v[c] : dot(nv, row, at->v);
        const double rate = wanted_rate(plan, number, error[i], bias[i], drift[i], moving);
        if (is_rate) error[i] = moving + bias[i]; /* reported only: the law does not use it */
        if (block->held || plan->rows) {
            store_row(plan, block, i, row, rate, bias[i], qp);
            continue;
        }
        wanted[i] = weight[i] * rate;
        if (is_diagonal) {
            qp->P[c * n + c] += size;
            qp->g[c] -= weight[i] * wanted[i];
        } else {
            for (int64_t j = 0; j < nv; j++) row[j] *= weight[i];
            size = dot(nv, row, row);
        }
        if (size > *qp->heaviest) *qp->heaviest = size;
    }
    if (!block->held && !plan->rows && !is_diagonal) add_squares(nv, k, J, wanted, qp->P, n, qp->g);
}

WIDE void add_costs(const wbc_plan *plan, int64_t level, double *J, double *P, double *g, double *heaviest) {
    const int64_t nv = plan->tree->nv, n = nv + plan->forces;
    const wbc_costs stored = stored_costs(plan);
    for (const wbc_block *block = plan->block; block < plan->block + plan->blocks; block++) {
        if (block->held || (level >= 0 && block->level != level)) continue;
        const double *weight = plan->number + block->number + WEIGHTS;
        const int64_t k = block->rows, width = is_of_forces(block) ? n : nv;
        double *wanted = J + k * width;
        for (int64_t i = 0; i < k; i++) {
            const double *from = stored.matrix + (block->first + i) * n;
            const int64_t c = 6 + plan->index[block->index + i];
            double *row = J + i * width, size = weight[i] * weight[i];
            wanted[i] = weight[i] * stored.target[block->first + i];
            if (block->kind == JOINTS) P[c * n + c] += size, g[c] -= weight[i] * wanted[i];
            else {
                for (int64_t j = 0; j < width; j++) row[j] = weight[i] * from[j];
                size = dot(width, row, row);
            }
            if (size > *heaviest) *heaviest = size;
        }
        if (block->kind != JOINTS) add_squares(width, k, J, wanted, P, n, g);
    }
}

void finish_cost(const wbc_plan *plan, int64_t level, const double *v, double damping, double *work, double *P,
                 double *g) {
    const int64_t nv = plan->tree->nv, n = nv + plan->forces, wide = plan->wide;
    const int64_t first = level < 0 ? 0 : level, last = level < 0 ? plan->levels - 1 : level;
    const wbc_costs stored = stored_costs(plan);
    for (int64_t i = 0; i < wide; i++)
        for (int64_t j = i + 1; j < wide; j++) P[j * n + i] = P[i * n + j];
    if (plan->curved) {
        double *H = work, largest = 0.0;
        for (int64_t i = 0; i < nv; i++) memcpy(H + i * nv, P + i * n, nv * sizeof *H);
        for (int64_t l = first; l <= last; l++)
            for (int64_t i = 0; i < nv * nv; i++) {
                const double entry = stored.curvature[l * nv * nv + i];
                H[i] += entry;
                if (fabs(entry) > largest) largest = fabs(entry);
            }
        if (largest > 0.0) {
            convexify(nv, H, H + nv * nv);
            for (int64_t i = 0; i < nv; i++) memcpy(P + i * n, H + i * nv, nv * sizeof *H);
        }
    }
    for (int64_t l = first; plan->rows && l <= last; l++)
        for (int64_t i = 0; i < nv; i++) P[i * n + i] += stored.damping[l * nv + i];
    for (int64_t i = 0; i < n; i++) {
        P[i * n + i] += plan->damping[i] + (i < nv ? damping : 0.0);
        if (plan->torque && i < nv) g[i] -= plan->damping[i] * v[i];
    }
}

/* The inequality rows given by Python, behind all others. */
static void add_given_bounds(const wbc_plan *plan, const wbc_qp *qp) {
    const int64_t nv = plan->tree->nv, n = qp->n, k = plan->given_rows, begin = qp->m - k;
    const double *lower = plan->given + k * nv, *upper = lower + k;
    for (int64_t r = 0; r < k; r++) {
        double *to = qp->C + (begin + r) * n;
        memcpy(to, plan->given + r * nv, nv * sizeof *to);
        memset(to + nv, 0, (n - nv) * sizeof *to);
        qp->l[begin + r] = lower[r], qp->u[begin + r] = upper[r];
    }
}

INLINE int is_finite_enough(const double *values, int64_t n) {
    return dot(n, values, values) < wbc_largest_qp * wbc_largest_qp;
}

static int is_range(double lower, double upper) { return lower <= upper && lower < INFINITY && upper > -INFINITY; }

WIDE int is_qp(const wbc_qp *qp) {
    const int64_t n = qp->n;
    for (int64_t i = 0; i < n; i++)
        if (!is_range(qp->lower[i], qp->upper[i])) return 0;
    for (int64_t i = 0; i < qp->m; i++)
        if (!is_range(qp->l[i], qp->u[i])) return 0;
    for (int64_t i = qp->wide; i < n; i++) /* beyond wide only the diagonal is not 0 */
        if (!is_finite_enough(qp->P + i * (n + 1), 1)) return 0;
    return is_finite_enough(qp->P, qp->wide * n) && is_finite_enough(qp->A, qp->k * n) &&
           is_finite_enough(qp->C, qp->m * n) && is_finite_enough(qp->g, n) && is_finite_enough(qp->b, qp->k);
}

int wbc_problem(const wbc_plan *plan, const double *state, const void *measured, const double *v) {
    const int64_t nv = plan->tree->nv;
    const double *q = measured;
    v = velocity_of(plan->tree, q, v);
    if (!state) {
        wbc_state(plan->tree, q, v, plan->state, plan->scratch, 0, 0, 0);
        state = plan->state;
    }
    double *frames = plan->scratch, *accelerations = frames + plan->frames * FRAME_SIZE(nv);
    double *motion = accelerations + 6 * plan->frames;
    double *J = motion + (plan->torque ? MOTION_SIZE(nv, plan->tree->joints) : 0);
    const wbc_state_at at = {state, q, v, frames, motion, accelerations};
    double damping = 0.0;
    wbc_qp qp;
    lay_out(plan, &qp);
    memset(qp.P, 0, qp.n * qp.n * sizeof *qp.P);
    memset(qp.g, 0, qp.n * sizeof *qp.g);
    memset(qp.found, 0, 5 * sizeof *qp.found);
    *qp.heaviest = 0.0;
    if (plan->rows)
        memset(stored_costs(plan).damping, 0, plan->levels * nv * (plan->curved ? 1 + nv : 1) * sizeof *plan->rows);
    wbc_frames(plan->tree, state, plan->frames, plan->frame_joint, plan->frame_placement, frames);
    if (plan->torque) {
        wbc_motion(plan->tree, state, v, motion, J);
        wbc_drifts(plan->tree, state, motion, plan->frames, plan->frame_joint, plan->frame_placement, accelerations);
    }
    for (const wbc_block *block = plan->block; block < plan->block + plan->blocks; block++)
        if (is_of_forces(block)) {
            if (block->kind == COP) add_moments(plan, block, frames);
            add_force_rows(plan, block, J, &qp);
        } else add_block(plan, block, &at, J, &qp, &damping);
    if (plan->torque) add_dynamics(plan, state, frames, motion, q, v, &qp);
    if (plan->rows) add_costs(plan, 0, J, qp.P, qp.g, qp.heaviest);
    const int kept = plan->margin ? add_margin(plan, state, v, J, &qp) : DONE;
    if (kept != DONE) return kept;
    add_given_bounds(plan, &qp);
    for (int64_t i = 0; i < nv; i++) qp.lower[i] = -INFINITY, qp.upper[i] = INFINITY;
    if (plan->limited) limits_box(plan, q, v, qp.lower, qp.upper);
    recover(plan, q, v, &qp);
    finish_cost(plan, 0, v, damping, J, qp.P, qp.g);
    return is_qp(&qp) ? DONE : NOT_FINITE;
}

int wbc_cost(const wbc_plan *plan, const double *q, const double *v, int64_t level, double *P, double *g) {
    const int64_t nv = plan->tree->nv, n = nv + plan->forces;
    double heaviest = 0.0;
    memset(P, 0, n * n * sizeof *P);
    memset(g, 0, n * sizeof *g);
    add_costs(plan, level, plan->scratch, P, g, &heaviest);
    finish_cost(plan, level, velocity_of(plan->tree, q, v), 0.0, plan->scratch, P, g);
    return DONE;
}
