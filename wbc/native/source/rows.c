/* Rows of tasks and contacts, limits, and the QP of a plain tick: what the residuals of wbc/tasks
 * and wbc/constraints, VelocityLaw.rows, Limits.box and assemble in wbc/controllers/plan.py say.
 */
#include "core.h"
#include "linear.h"

#include <string.h>

/* As in wbc/constraints/limits.py. */
static const double AT_LIMIT = 1e-9, FAR = 1e12;
/* Nearer to half a turn than this [rad] the logarithm is left to Pinocchio. */
static const double TURN = 0.01;
/* Below this angle [rad] series, which lose nothing. */
static const double SMALL = 0.1;
static const double PI = 3.14159265358979323846;
static const double NO_LIMIT = 1e150; /* as LARGEST in wbc/qp/problem.py */

/* Rotation vector of R; false too near to half a turn. */
static int logarithm(const double *R, double *r) {
    const double w[3] = {0.5 * (R[7] - R[5]), 0.5 * (R[2] - R[6]), 0.5 * (R[3] - R[1])};
    const double sine = sqrt(dot3(w, w)), cosine = 0.5 * (R[0] + R[4] + R[8] - 1.0);
    double factor;
    if (sine < SMALL && cosine > 0.0) { /* asin(s) / s */
        const double s = sine * sine;
        factor = 1.0 + s * (1.0 / 6 + s * (3.0 / 40 + s * (15.0 / 336 + s * (105.0 / 3456 +
                 s * (945.0 / 42240 + s * (10395.0 / 599040))))));
    } else {
        const double angle = atan2(sine, cosine);
        if (!(angle < PI - TURN)) return 0;
        factor = angle / sine;
    }
    for (int i = 0; i < 3; i++) r[i] = factor * w[i];
    return 1;
}

/* J of d(log R)/dt = J w, w in R's own axes: 1 + [r]/2 + c [r]^2. */
static void log_jacobian(const double *r, double *J) {
    const double t2 = dot3(r, r), t = sqrt(t2);
    const double c = t < SMALL
                         ? 1.0 / 12 + t2 * (1.0 / 720 + t2 * (1.0 / 30240 + t2 / 1209600))
                         : 1.0 / t2 - 1.0 / (2.0 * t * tan(0.5 * t));
    const double x = 0.5 * r[0], y = 0.5 * r[1], z = 0.5 * r[2];
    const double skew[9] = {0.0, -z, y, z, 0.0, -x, -y, x, 0.0};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            J[3 * i + j] = skew[3 * i + j] + c * r[i] * r[j] + (i == j ? 1.0 - c * t2 : 0.0);
}

/* Position of a joint [rad or m]; start is negative, and one less, where q holds (cos, sin). */
static double joint_position(const wbc_plan *plan, const double *q, int64_t joint) {
    const int64_t start = plan->start[joint];
    return start >= 0 ? q[start] : atan2(q[-start], q[-start - 1]);
}

static int is_continuous(const wbc_plan *plan, int64_t joint) { return plan->start[joint] < 0; }

static void copy_row(double *to, const double *from, int64_t n) { memcpy(to, from, n * sizeof *to); }

/* Errors e and matrix J of a block, with what curvature it leaves out; false: handed over. */
static int evaluate(const wbc_plan *plan, const wbc_block *block, const double *state,
                    const double *frames, const double *q, double *J, double *e, double *bias,
                    double *bound) {
    const int64_t nv = plan->tree->nv, k = block->rows, *chosen = plan->index + block->index;
    const double *number = plan->number + block->number, *weight = number + WEIGHTS;
    const double *own = weight + 2 * k;
    const double *frame = frames + block->frame * FRAME_SIZE(nv);
    const double *jacobian = frame + FRAME_JACOBIAN, *R = frame + FRAME_ROTATION;
    const double trace = state[INERTIA] + state[INERTIA + 4] + state[INERTIA + 8];
    double relative[9], to_error[9], matrix[9], all[6], pull[6] = {0.0};
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
        return 1;
    }
    case ORIENTATION: /* own: target (3, 3), its angular velocity (3) */
        transposed_product3(own, R, relative);
        if (!logarithm(relative, e)) return 0;
        log_jacobian(e, matrix);
        for (int i = 0; i < 3; i++) times3(R, matrix + 3 * i, to_error + 3 * i);
        for (int i = 0; i < 3; i++) {
            const double *T = to_error + 3 * i;
            for (int64_t c = 0; c < nv; c++)
                J[i * nv + c] = T[0] * jacobian[3 * nv + c] + T[1] * jacobian[4 * nv + c] +
                                T[2] * jacobian[5 * nv + c];
            bias[i] = -dot3(T, own + 9);
        }
        return 1;
    case INERTIA_ENTRIES: { /* own: selection (k, 6), what it should give (k) */
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
            for (int j = 0; j < 6; j++) pull[j] += weight[i] * weight[i] * e[i] * s[j];
            if (block->frame < 0)
                for (int64_t c = 0; c < nv; c++) {
                    double sum = 0.0;
                    for (int j = 0; j < 6; j++) sum += s[j] * rates[j * nv + c];
                    J[i * nv + c] = sum;
                }
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
        *bound = sqrt(dot3(pull, pull) + dot3(pull + 3, pull + 3)) * trace;
        return 1;
    }
    case JOINTS: /* own: wanted positions (k); the matrix is known: 1 at 6 + chosen */
        for (int64_t i = 0; i < k; i++) {
            e[i] = joint_position(plan, q, chosen[i]) - own[i];
            if (is_continuous(plan, chosen[i])) e[i] = remainder(e[i], 2.0 * PI);
        }
        return 1;
    case MOMENTUM_ENTRIES:
        for (int64_t i = 0; i < k; i++) {
            e[i] = 0.0;
            copy_row(J + i * nv, state + CENTROIDAL_MAP + chosen[i] * nv, nv);
        }
        return 1;
    case CONTACT: { /* own: position (3), rotation (3, 3) */
        double drift[6], turn[3];
        for (int i = 0; i < 3; i++) drift[i] = frame[i] - own[i];
        transposed_product3(own + 3, R, relative);
        if (!logarithm(relative, turn)) return 0;
        times3(R, turn, drift + 3);
        for (int64_t i = 0; i < k; i++) {
            e[i] = drift[chosen[i]];
            copy_row(J + i * nv, jacobian + chosen[i] * nv, nv);
        }
        return 1;
    }
    default: /* LINEAR in the joints; own: matrix (k, nv), offsets (k) */
        copy_row(J, own, k * nv);
        for (int64_t i = 0; i < k; i++) {
            e[i] = -own[k * nv + i];
            for (int64_t c = 6; c < nv; c++)
                if (own[i * nv + c] != 0.0)
                    e[i] += own[i * nv + c] * joint_position(plan, q, c - 6);
        }
        return 1;
    }
}

/* P += J' J on and above the diagonal, g -= J' wanted, rows weighted already */
static void square(int64_t nv, int64_t rows, const double *restrict J, const double *wanted,
                   double *restrict P, double *restrict g) {
    for (int64_t r = 0; r < rows; r += 3) {
        const double *a = J + r * nv, *b = r + 1 < rows ? a + nv : 0, *c = r + 2 < rows ? b + nv : 0;
        if (c) {
            for (int64_t i = 0; i < nv; i++) {
                const double x = a[i], y = b[i], z = c[i];
                if (x == 0.0 && y == 0.0 && z == 0.0) continue;
                double *restrict to = P + i * nv;
                for (int64_t j = i; j < nv; j++) to[j] += x * a[j] + y * b[j] + z * c[j];
                g[i] -= wanted[r] * x + wanted[r + 1] * y + wanted[r + 2] * z;
            }
        } else {
            for (int64_t s = r; s < rows; s++) {
                const double *one = J + s * nv;
                for (int64_t i = 0; i < nv; i++) {
                    if (one[i] == 0.0) continue;
                    for (int64_t j = i; j < nv; j++) P[i * nv + j] += one[i] * one[j];
                    g[i] -= wanted[s] * one[i];
                }
            }
        }
    }
}

/* The box on v+ of wbc.constraints.Limits with free braking. */
static int bound(const wbc_plan *plan, const double *q, const double *v, int64_t moving,
                 double *lower, double *upper) {
    const int64_t n = plan->tree->nv - 6;
    const double *lo = plan->limit, *up = lo + n, *speed = up + n, *slow = speed + n;
    const double dt = plan->dt, *base = slow + n;
    for (int i = 0; i < 6; i++) lower[i] = base[i], upper[i] = base[6 + i];
    for (int64_t k = 0; k < n; k++) {
        const double position = joint_position(plan, q, k), start = slow[k] * dt;
        const double left[2] = {position - lo[k], up[k] - position};
        double most[2];
        for (int side = 0; side < 2; side++) {
            if (left[side] < -AT_LIMIT) return OUTSIDE_LIMITS;
            const double reach = left[side] < 0.0 ? 0.0 : left[side] > FAR ? FAR : left[side];
            most[side] = 2.0 * reach / (sqrt(2.0 * reach / slow[k] + dt * dt) + dt);
            if (left[side] > FAR) most[side] = INFINITY;
            if (most[side] > speed[k]) most[side] = speed[k];
            if (moving) { /* it may stop, and start the other way in the same tick */
                const double change = (side ? v[6 + k] : -v[6 + k]) + start;
                const double limit = change > start ? change : start;
                if (most[side] > limit) most[side] = limit;
            }
        }
        lower[6 + k] = -most[0], upper[6 + k] = most[1];
    }
    return DONE;
}

static int is_sound(const double *values, int64_t n) {
    double sum = 0.0;
    for (int64_t i = 0; i < n; i++) sum += values[i] * values[i];
    return sum < NO_LIMIT * NO_LIMIT;
}

int wbc_problem(const wbc_plan *plan, const double *state, const double *q, const double *v,
                int64_t moving) {
    const int64_t nv = plan->tree->nv, held = plan->held;
    double *P = plan->out, *A = P + nv * nv, *g = A + held * nv, *lower = g + nv;
    double *upper = lower + nv, *b = upper + nv, *errors = b + held;
    double *frames = plan->scratch, *J = frames + plan->frames * FRAME_SIZE(nv);
    double *e = J + (plan->costs > 6 ? plan->costs : 6) * nv, damping = 0.0, heaviest = 0.0;
    double curved;
    memset(P, 0, nv * nv * sizeof *P);
    memset(g, 0, nv * sizeof *g);
    wbc_frames(plan->tree, state, plan->frames, plan->frame_joint, plan->frame_placement, frames);
    for (const wbc_block *block = plan->block; block < plan->block + plan->blocks; block++) {
        const int64_t k = block->rows;
        const double *number = plan->number + block->number, *weight = number + WEIGHTS;
        double *error = block->held ? e : errors + block->first, *bias = e + k;
        double *rows = block->held ? A + block->first * nv : J;
        if (!evaluate(plan, block, state, frames, q, rows, error, bias, &curved))
            return HALF_A_TURN;
        if (block->held) {
            for (int64_t i = 0; i < k; i++)
                b[block->first + i] = -number[RATE] * error[i] - bias[i];
            continue;
        }
        damping += number[HALF_GAIN] * curved;
        if (number[LM_DAMPING] > 0.0) {
            double sum = 0.0;
            for (int64_t i = 0; i < k; i++) sum += weight[i] * error[i] * weight[i] * error[i];
            damping += number[LM_DAMPING] * sqrt(sum);
        }
        for (int64_t i = 0; i < k; i++) {
            const double wanted = weight[i] * (-number[RATE] * error[i] - bias[i]);
            double size = weight[i] * weight[i];
            if (block->kind == JOINTS) {
                const int64_t c = 6 + plan->index[block->index + i];
                P[c * nv + c] += weight[i] * weight[i];
                g[c] -= weight[i] * wanted;
            } else {
                size = 0.0;
                for (int64_t c = 0; c < nv; c++) {
                    J[i * nv + c] *= weight[i];
                    size += J[i * nv + c] * J[i * nv + c];
                }
                bias[i] = wanted;
            }
            if (size > heaviest) heaviest = size;
        }
        if (block->kind != JOINTS) square(nv, k, J, bias, P, g);
    }
    errors[plan->costs] = heaviest;
    for (int64_t i = 0; i < nv; i++) {
        P[i * nv + i] += plan->damping[i] + damping;
        for (int64_t j = i + 1; j < nv; j++) P[j * nv + i] = P[i * nv + j];
        lower[i] = -INFINITY, upper[i] = INFINITY;
    }
    if (plan->limited && bound(plan, q, v, moving, lower, upper) != DONE) return OUTSIDE_LIMITS;
    for (int64_t i = 0; i < nv; i++)
        if (!(lower[i] <= upper[i])) return NOT_FINITE;
    return is_sound(P, nv * nv + held * nv + nv) && is_sound(b, held) ? DONE : NOT_FINITE;
}
