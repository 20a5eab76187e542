/* The API: write targets to the plan, run the core, read its solution. */
#include "controller.h"
#include "core/problem.h"

#include <string.h>

int wbc_start(wbc_controller *c) {
    memset(c, 0, sizeof *c);
    c->plan = wbc_planned;
    memcpy(c->number, wbc_planned.number, sizeof c->number);
    c->plan.number = c->number, c->plan.state = c->state, c->plan.out = c->out;
    c->plan.scratch = c->scratch, c->plan.order = c->order;
    return DONE;
}

int wbc_target_sizes(int part, int sizes[3]) {
    if (part < 0 || part >= WBC_PARTS) return NO_TARGET;
    sizes[0] = sizes[1] = sizes[2] = 3;
    switch (wbc_planned.block[part].kind) {
    case POINT:
    case POINTING:
        return DONE;
    case ORIENTATION:
        sizes[0] = 9;
        return DONE;
    case INERTIA_ENTRIES:
        sizes[0] = sizes[1] = sizes[2] = 6;
        return DONE;
    case JOINTS:
        sizes[0] = sizes[1] = sizes[2] = WBC_NV - 6;
        return DONE;
    case MOMENTUM_ENTRIES:
        sizes[0] = sizes[1] = 6, sizes[2] = 0;
        return DONE;
    case CONTACT:
        sizes[0] = 12, sizes[1] = sizes[2] = 0;
        return DONE;
    default:
        return NO_TARGET;
    }
}

static double at(const double *values, int64_t i) { return values ? values[i] : 0.0; }

static void copy(double *to, const double *from, int n) {
    for (int i = 0; i < n; i++) to[i] = at(from, i);
}

int wbc_set_target(wbc_controller *c, int part, const double *target, const double *rate,
                   const double *acceleration) {
    int sizes[3];
    if (wbc_target_sizes(part, sizes) != DONE) return NO_TARGET;
    const wbc_block *block = wbc_planned.block + part;
    const int64_t k = block->rows, *chosen = wbc_planned.index + block->index;
    double *bias = c->number + block->number + WEIGHTS + k, *drift = bias + k, *own = drift + k;
    if (block->kind == ORIENTATION) {
        copy(own, target, 9), copy(own + 9, rate, 3), copy(own + 12, acceleration, 3);
        return DONE;
    }
    if (block->kind == POINT || block->kind == POINTING || block->kind == CONTACT) copy(own, target, sizes[0]);
    for (int64_t i = 0; i < k; i++) {
        const double *s = own + 6 * i; /* of an inertia: the selection */
        double *wanted = own + 6 * k + i;
        switch (block->kind) {
        case POINT:
        case POINTING:
            bias[i] = -at(rate, chosen[i]), drift[i] = -at(acceleration, chosen[i]);
            break;
        case JOINTS:
            own[i] = at(target, chosen[i]);
            bias[i] = -at(rate, chosen[i]), drift[i] = -at(acceleration, chosen[i]);
            break;
        case MOMENTUM_ENTRIES:
            bias[i] = -at(target, chosen[i]), drift[i] = -at(rate, chosen[i]);
            break;
        case INERTIA_ENTRIES:
            *wanted = bias[i] = drift[i] = 0.0;
            for (int j = 0; j < 6; j++) {
                *wanted += s[j] * at(target, j);
                bias[i] -= s[j] * at(rate, j), drift[i] -= s[j] * at(acceleration, j);
            }
            break;
        default:
            break;
        }
    }
    return DONE;
}

int wbc_control(wbc_controller *c, const double q[WBC_NQ], const double *v, wbc_command *command) {
    static const double still[WBC_NV] = {0.0};
    const wbc_plan *plan = &c->plan;
    wbc_qp qp;
    const int status = wbc_tick(plan, 0, q, v ? v : still);
    if (status != DONE) return status;
    lay_out(plan, &qp);
    memset(command, 0, sizeof *command);
    memcpy(command->velocity, plan->torque ? qp.exact : qp.x, sizeof command->velocity);
    if (!plan->torque) return DONE;
    memcpy(command->torque, qp.torque, sizeof command->torque);
    for (int64_t i = 0; i < plan->bounded; i++) { /* within the tolerance of the solver */
        double *torque = command->torque + plan->with_bound[i] - 6;
        const double most = plan->unit * plan->torque_bound[i];
        *torque = *torque > most ? most : *torque < -most ? -most : *torque;
    }
    return DONE;
}
