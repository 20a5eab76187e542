#include "safety.h"

#include <string.h>

static double clip(double x, double low, double high) { return fmin(fmax(x, low), high); }

/* ---- modes ---- */

void wbc_safety_start(wbc_safety *s) {
    memset(s, 0, sizeof *s);
    s->mode = WBC_MODE_IDLE, s->cause = -1;
    s->brake.enabled = 1;
    for (int j = 0; j < WBC_JOINTS; j++) s->brake.kd[j] = fmin(wbc_damping[j], wbc_limits.kd[j]);
    s->last = s->off;
}

int wbc_safety_to(wbc_safety *s, int mode) {
    if (!(wbc_transitions[s->mode] >> mode & 1)) return 0;
    s->mode = mode;
    return 1;
}

int wbc_safety_arm(wbc_safety *s) { return wbc_safety_to(s, WBC_MODE_DAMPING); }

int wbc_safety_reset(wbc_safety *s) {
    if (!wbc_safety_to(s, WBC_MODE_IDLE)) return 0;
    memset(s->borne, 0, sizeof s->borne);
    return 1;
}

int wbc_safety_stand_up(wbc_safety *s) {
    if (!s->measured) return 0;
    for (int f = 0; f < WBC_FAULTS; f++)
        if (s->borne[f] > 0.0 && wbc_rules[f].answer > WBC_ANSWER_NOTE) return 0;
    return wbc_safety_to(s, WBC_MODE_STANDING_UP);
}

void wbc_safety_stop(wbc_safety *s) {
    if (s->mode != WBC_MODE_IDLE && s->mode != WBC_MODE_STOP) wbc_safety_to(s, WBC_MODE_STOP);
}

/* ---- faults ---- */

void wbc_safety_report(wbc_safety *s, int fault) {
    for (int k = 0; k < s->reported; k++)
        if (s->order[k] == fault) return;
    s->order[s->reported++] = fault;
}

/* NaN is beyond every limit. */
static int beyond(double value, double most) { return !(value <= most); }

static int is_plausible(double position, double velocity) {
    return fabs(position) < WBC_HUGE && fabs(velocity) < WBC_HUGE;
}

void wbc_safety_measured(wbc_safety *s, const wbc_reading *r) {
    const wbc_safety_limits *l = &wbc_limits;
    const double *x = r->quaternion, *up = l->up;
    int position = 0, velocity = 0, overload = 0, warm = 0, hot = 0;
    int plausible = x[0] != 0.0 || x[1] != 0.0 || x[2] != 0.0 || x[3] != 0.0; /* zeros would count as upright */
    for (int j = 0; j < WBC_JOINTS; j++) plausible &= is_plausible(r->position[j], r->velocity[j]);
    if (!plausible) {
        wbc_safety_report(s, WBC_FAULT_NOT_FINITE);
        return;
    }
    for (int j = 0; j < WBC_JOINTS; j++) {
        s->q[j] = r->position[j], s->v[j] = r->velocity[j];
        position |= beyond(r->position[j] - l->upper[j], l->overrun);
        position |= beyond(l->lower[j] - r->position[j], l->overrun);
        velocity |= beyond(fabs(r->velocity[j]) - l->overspeed * l->velocity[j], 0.0);
        overload |= beyond(fabs(r->torque[j]) - l->overload * l->effort[j], 0.0);
        warm |= beyond(r->temperature[j], l->warm), hot |= beyond(r->temperature[j], l->hot);
    }
    s->measured = 1;
    if (position) wbc_safety_report(s, WBC_FAULT_POSITION);
    if (velocity) wbc_safety_report(s, WBC_FAULT_VELOCITY);
    if (overload) wbc_safety_report(s, WBC_FAULT_OVERLOAD);
    if (warm) wbc_safety_report(s, WBC_FAULT_WARM);
    if (hot) wbc_safety_report(s, WBC_FAULT_HOT);
    const double vertical = 2.0 * (x[0] * x[2] - x[3] * x[1]) * up[0] + 2.0 * (x[1] * x[2] + x[3] * x[0]) * up[1] +
                            (1.0 - 2.0 * (x[0] * x[0] + x[1] * x[1])) * up[2];
    if (!(vertical >= l->least_vertical)) wbc_safety_report(s, WBC_FAULT_TILT);
    if (r->stop) wbc_safety_report(s, WBC_FAULT_BUTTON);
}

int wbc_safety_judge(wbc_safety *s) {
    int answer = WBC_ANSWER_NOTE, present[WBC_FAULTS] = {0};
    s->cause = -1;
    for (int k = 0; k < s->reported; k++) {
        const int f = s->order[k];
        const wbc_rule *rule = wbc_rules + f;
        present[f] = 1, s->counts[f]++, s->borne[f] = fmin(s->borne[f], rule->patience) + WBC_CYCLE;
        if (s->borne[f] > rule->patience + 1e-9 && rule->answer > answer) answer = rule->answer, s->cause = f;
    }
    for (int f = 0; f < WBC_FAULTS; f++)
        if (!present[f] && s->borne[f] > 0.0) s->borne[f] = fmax(s->borne[f] - 0.5 * WBC_CYCLE, 0.0);
    s->reported = 0;
    if (answer == WBC_ANSWER_STOP) wbc_safety_stop(s);
    else if (answer == WBC_ANSWER_SOFT_STOP) wbc_safety_to(s, WBC_MODE_SOFT_STOP);
    return s->mode;
}

/* ---- commands ---- */

static int is_finite(const wbc_motors *c) {
    double sum = 0.0; /* 0 x is NaN of what is not finite */
    for (int j = 0; j < WBC_JOINTS; j++)
        sum += 0.0 * c->position[j] + 0.0 * c->velocity[j] + 0.0 * c->torque[j] + 0.0 * c->kp[j] + 0.0 * c->kd[j];
    return sum == 0.0;
}

double wbc_nearest_turn(int j, double position, double to) {
    static const double turn = 6.28318530717958647692; /* rad */
    const double way = position - to;                  /* too far to be a position: that stays */
    const int endless = isinf(wbc_limits.lower[j]) && isinf(wbc_limits.upper[j]) && fabs(way) < WBC_HUGE;
    return endless ? position - turn * rint(way / turn) : position;
}

/* Reduce gains and torques so that motors give at most their effort at the present state. */
static void limit_effort(const wbc_safety *s, wbc_motors *c) {
    for (int j = 0; j < WBC_JOINTS; j++) {
        const double effort = wbc_limits.effort[j];
        const double whole = c->kp[j] * (c->position[j] - s->q[j]) + c->kd[j] * (c->velocity[j] - s->v[j]);
        const double share = fmin(1.0, effort / fmax(fabs(whole), 1e-9)), feedback = share * whole;
        const double torque = clip(c->torque[j] + feedback, -effort, effort) - feedback;
        c->torque[j] = clip(torque, -effort, effort), c->kp[j] *= share, c->kd[j] *= share;
    }
}

/* Repeat the last command, with less if the joints have moved so that it exceeds the effort. */
static void hold(wbc_safety *s) {
    double torque[WBC_JOINTS];
    int over = 0;
    for (int j = 0; j < WBC_JOINTS; j++) s->last.position[j] = wbc_nearest_turn(j, s->last.position[j], s->q[j]);
    wbc_motor_torque(&s->last, s->q, s->v, torque);
    for (int j = 0; j < WBC_JOINTS; j++) over |= fabs(torque[j]) > wbc_limits.effort[j] + 1e-9;
    if (over) limit_effort(s, &s->last);
}

static void limit(wbc_safety *s, const wbc_motors *wanted) {
    const wbc_safety_limits *l = &wbc_limits;
    wbc_motors limited = s->last;
    int far = 0;
    double clipped = 0.0;
    for (int j = 0; j < WBC_JOINTS; j++) {
        const double goal = wbc_nearest_turn(j, wanted->position[j], s->q[j]);
        const double last = wbc_nearest_turn(j, limited.position[j], s->q[j]);
        const double held = limited.kp[j] > 0.0 ? last : s->q[j], reach = l->velocity[j] * WBC_CYCLE;
        const double near = clip(goal, held - reach, held + reach), step = l->torque_rate[j] * WBC_CYCLE;
        limited.position[j] = clip(near, l->lower[j], l->upper[j]);
        limited.velocity[j] = clip(wanted->velocity[j], -l->velocity[j], l->velocity[j]);
        limited.torque[j] = clip(wanted->torque[j], limited.torque[j] - step, limited.torque[j] + step);
        limited.kp[j] = clip(wanted->kp[j], 0.0, l->kp[j]), limited.kd[j] = clip(wanted->kd[j], 0.0, l->kd[j]);
        far |= !is_plausible(limited.position[j], limited.velocity[j]);
    }
    if (far) { /* joints without limits */
        wbc_safety_report(s, WBC_FAULT_COMMAND_NOT_FINITE);
        hold(s);
        return;
    }
    limit_effort(s, &limited);
    for (int j = 0; j < WBC_JOINTS; j++) clipped = fmax(clipped, fabs(limited.torque[j] - wanted->torque[j]));
    limited.enabled = 1, s->last = limited;
    if (clipped > 1e-6) wbc_safety_report(s, WBC_FAULT_CLIPPED);
}

const wbc_motors *wbc_safety_admit(wbc_safety *s, const wbc_motors *wanted) {
    if (s->mode == WBC_MODE_IDLE) s->last = s->off;
    else if (s->mode == WBC_MODE_DAMPING || s->mode == WBC_MODE_STOP || !s->measured) s->last = s->brake;
    else if (wanted && is_finite(wanted)) limit(s, wanted);
    else {
        if (wanted) wbc_safety_report(s, WBC_FAULT_COMMAND_NOT_FINITE);
        hold(s);
    }
    return &s->last;
}

void wbc_motor_torque(const wbc_motors *c, const double *q, const double *v, double *torque) {
    for (int j = 0; j < WBC_JOINTS; j++)
        torque[j] = !c->enabled
                        ? 0.0
                        : c->torque[j] + c->kp[j] * (c->position[j] - q[j]) + c->kd[j] * (c->velocity[j] - v[j]);
}
