#include "checks.h"
#include "linear.h"

#include <string.h>

void wbc_checks_start(wbc_checks *c) {
    memset(c, 0, sizeof *c);
    c->sequence = -1, c->gravity[2] = 9.81;
}

static const wbc_reading *past(const wbc_checks *c, int k) { return c->past + (c->first + k) % WBC_PAST; }

static void clear_window(wbc_checks *c) {
    c->count = 0;
    memset(c->velocities, 0, sizeof c->velocities);
    memset(c->spins, 0, sizeof c->spins);
}

static void add_to_sums(wbc_checks *c, const wbc_reading *r, double sign) {
    for (int j = 0; j < WBC_JOINTS; j++) c->velocities[j] += sign * r->velocity[j];
    for (int i = 0; i < 3; i++) c->spins[i] += sign * r->rate[i];
}

static void drop_oldest(wbc_checks *c) {
    add_to_sums(c, past(c, 0), -1.0);
    c->first = (c->first + 1) % WBC_PAST, c->count--;
}

/* ---- rejected readings ---- */

static int finite(const wbc_reading *r) {
    double sum = 0.0 * r->time; /* 0 x is NaN of what is not finite */
    for (int j = 0; j < WBC_JOINTS; j++)
        sum += 0.0 * r->position[j] + 0.0 * r->velocity[j] + 0.0 * r->torque[j] + 0.0 * r->temperature[j];
    for (int i = 0; i < 4; i++) sum += 0.0 * r->quaternion[i];
    for (int i = 0; i < 3; i++) sum += 0.0 * r->rate[i] + 0.0 * r->force[i];
    return sum == 0.0;
}

static int timely(wbc_checks *c, double time, double now) {
    const double offset = now - time;
    if (!c->knows_offset) c->offset = c->last_offset = offset, c->knows_offset = 1;
    const double age = offset - c->offset;
    const int jumped = age > WBC_CLOCK_JUMP || age < 0.0; /* what is late by less may be delayed for long */
    if (fabs(age) <= WBC_MAX_AGE) {
        /* The freshest two readings so far are new, since one time may be wrong; 1e-4 of it is forgotten, for clocks
         * that drift. */
        c->offset = fmin(fmax(offset, c->last_offset), c->offset + 1e-4 * fmax(age, 0.0));
        c->last_offset = offset, c->strangers = 0;
        return -1;
    }
    if (c->strangers == WBC_CLOCK_AGREEMENT) memmove(c->strange, c->strange + 1, --c->strangers * sizeof *c->strange);
    c->strange[c->strangers++] = offset;
    double low = offset, high = offset;
    for (int k = 0; k < c->strangers; k++) low = fmin(low, c->strange[k]), high = fmax(high, c->strange[k]);
    if (c->strangers == WBC_CLOCK_AGREEMENT && high - low < WBC_MAX_AGE && jumped) {
        c->jumped_back += low - c->offset, c->strangers = 0;
        return WBC_FAULT_CLOCK_JUMPED;
    }
    return jumped ? WBC_FAULT_CLOCK_JUMPED : WBC_FAULT_OLD_READING;
}

static int possible(const wbc_reading *r) {
    double norm = 0.0;
    for (int j = 0; j < WBC_JOINTS; j++) {
        const double q = r->position[j];
        if (q - wbc_limits.upper[j] > WBC_MAX_OVERRUN || wbc_limits.lower[j] - q > WBC_MAX_OVERRUN) return 0;
        if (fabs(r->velocity[j]) - WBC_MAX_SPEED_RATIO * wbc_limits.velocity[j] > 0.0) return 0;
        if (r->temperature[j] < WBC_MIN_TEMPERATURE || r->temperature[j] > WBC_MAX_TEMPERATURE) return 0;
    }
    for (int i = 0; i < 4; i++) norm += r->quaternion[i] * r->quaternion[i];
    if (fabs(sqrt(norm) - 1.0) > WBC_NORM_TOLERANCE) return 0;
    for (int i = 0; i < 3; i++)
        if (fabs(r->rate[i]) > WBC_MAX_GYROSCOPE || fabs(r->force[i]) > WBC_MAX_ACCELEROMETER) return 0;
    return 1;
}

static double motion(const wbc_reading *before, const wbc_reading *now, int j) {
    return wbc_nearest_turn(j, now->position[j], before->position[j]) - before->position[j];
}

static int jumped(wbc_checks *c, const wbc_reading *r) {
    if (!c->count) return 0;
    const wbc_reading *last = past(c, c->count - 1);
    const double passed = fmax(r->time - last->time, 0.0);
    double along = 0.0;
    if (passed > WBC_WINDOW) { /* too long ago to compare */
        clear_window(c);
        return 0;
    }
    for (int j = 0; j < WBC_JOINTS; j++) {
        /* 5 rad/s beyond what was measured: the limits alone allow 0.06 rad. */
        const double fastest = fmin(wbc_limits.velocity[j], fabs(last->velocity[j]) + 5.0);
        if (fabs(motion(last, r, j)) - (WBC_POSITION_JUMP + passed * fastest) > 0.0) return 1;
    }
    for (int i = 0; i < 4; i++) along += r->quaternion[i] * last->quaternion[i];
    const double turn = 2.0 * acos(fmin(fabs(along), 1.0));
    return turn > 2.0 * WBC_POSITION_JUMP + passed * (sqrt(dot3(last->rate, last->rate)) + 10.0);
}

int wbc_checks_refused(wbc_checks *c, wbc_reading *r, double now) {
    int found = -1;
    r->time += c->jumped_back;
    /* A sequence far back has restarted; it is no late message. */
    if (r->sequence <= c->sequence && !(r->sequence < c->sequence - WBC_RESTART_GAP)) found = WBC_FAULT_OUT_OF_ORDER;
    else if (!finite(r)) found = WBC_FAULT_NOT_FINITE;
    else if ((found = timely(c, r->time, now)) < 0)
        found = !possible(r) ? WBC_FAULT_IMPLAUSIBLE : jumped(c, r) ? WBC_FAULT_JUMPED : -1;
    if (found < 0) c->sequence = r->sequence;
    return found;
}

/* ---- sensors that contradict each other ---- */

static double norm3(const double *a) { return sqrt(dot3(a, a)); }

static void compare_rates(const wbc_checks *c, const wbc_reading *r, wbc_safety *s) {
    if (!c->count || !(r->time - past(c, 0)->time >= 0.8 * WBC_WINDOW)) return;
    const wbc_reading *first = past(c, 0);
    const double passed = r->time - first->time, count = c->count + 1.0;
    double before[9], now[9], D[9];
    int disagrees = 0;
    for (int j = 0; j < WBC_JOINTS; j++) {
        const double rate = motion(first, r, j) / passed, reported = c->velocities[j] / count;
        const double larger = fmax(fabs(rate), fabs(reported));
        disagrees |= fabs(rate - reported) - WBC_RATE_OFFSET - WBC_RATE_RATIO * larger > 0.0;
    }
    if (disagrees) wbc_safety_report(s, WBC_FAULT_ENCODER_DISAGREES);
    from_quaternion(first->quaternion, before), from_quaternion(r->quaternion, now);
    transposed_product3(before, now, D);
    const double turn[3] = {0.5 * (D[7] - D[5]) / passed, 0.5 * (D[2] - D[6]) / passed, 0.5 * (D[3] - D[1]) / passed};
    double off[3], spun[3];
    for (int i = 0; i < 3; i++) spun[i] = c->spins[i] / count, off[i] = turn[i] - spun[i];
    if (norm3(off) > WBC_GYRO_TOLERANCE + WBC_GYRO_RATIO * fmax(norm3(turn), norm3(spun)))
        wbc_safety_report(s, WBC_FAULT_IMU_DISAGREES);
}

static void compare_gravity(wbc_checks *c, const wbc_reading *r, wbc_safety *s) {
    double R[9], force[3];
    from_quaternion(r->quaternion, R);
    times3(R, r->force, force);
    const double passed = c->count ? fmax(r->time - past(c, c->count - 1)->time, 0.0) : 0.0;
    const double share = fmin(passed / WBC_GRAVITY_TIME, 1.0);
    for (int i = 0; i < 3; i++) c->gravity[i] += share * (force[i] - c->gravity[i]);
    const double size = norm3(c->gravity); /* in free fall there is no direction */
    if (!c->count || (size >= WBC_MIN_GRAVITY && size <= WBC_MAX_GRAVITY)) c->weighed = r->time;
    if (r->time - c->weighed > WBC_MAX_FALL_TIME ||
        (size >= WBC_MIN_GRAVITY && c->gravity[2] < size * cos(WBC_GRAVITY_ANGLE)))
        wbc_safety_report(s, WBC_FAULT_GRAVITY_DISAGREES);
}

static void check_frozen(wbc_checks *c, const wbc_reading *r, wbc_safety *s) {
    const wbc_reading *last = c->count ? past(c, c->count - 1) : 0;
    for (int k = 0; k < 2; k++) {
        const double *now = k ? r->force : r->rate, *before = last ? (k ? last->force : last->rate) : now;
        const int same = now[0] == before[0] && now[1] == before[1] && now[2] == before[2];
        if (!last || !same) c->changed[k] = r->time;
        else if (r->time - c->changed[k] > WBC_FROZEN_TIME) wbc_safety_report(s, WBC_FAULT_IMU_FROZEN);
    }
}

void wbc_checks_compared(wbc_checks *c, const wbc_reading *r, const double *commanded, wbc_safety *s) {
    add_to_sums(c, r, 1.0);
    compare_rates(c, r, s), compare_gravity(c, r, s), check_frozen(c, r, s);
    for (int j = 0; commanded && j < WBC_JOINTS; j++)
        if (fabs(r->torque[j] - commanded[j]) - WBC_TORQUE_TOLERANCE * wbc_limits.effort[j] > 0.0) {
            wbc_safety_report(s, WBC_FAULT_TORQUE_DISAGREES);
            break;
        }
    if (c->count == WBC_PAST) drop_oldest(c); /* more readings than expected of a window */
    c->past[(c->first + c->count++) % WBC_PAST] = *r;
    while (r->time - past(c, 0)->time > WBC_WINDOW + 1e-9) drop_oldest(c);
}
