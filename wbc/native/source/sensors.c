/* Checks of the readings of joints and IMUs, and what replaces rejected ones. */
#include "estimator.h"
#include "linear.h"

#include <string.h>

static const double LEEWAY = 5e-3;   /* rad or m: tolerance of a joint's motion */
enum { AGREE = 5 };                  /* rejected readings in a row after which a joint is where they say */
enum { FROZEN = 25 };                /* identical readings in a row that make an IMU frozen */
static const double QUIET = 0.01;    /* s: an IMU may be slower than the messages */
static const double ROUNDING = 1e-6; /* s: of intervals; times may be of the system's clock */
static const double GUESSED = 100.0; /* variance of a held reading, by that of a fresh one */
static const double STRAYS = 3.0;    /* m/s^2: change of a robot's acceleration while a reading is held */

int wbc_joint_rates(int64_t window, int64_t n, double *times, double *positions, int64_t *count, double time,
                    const double *reading, double *rates) {
    double *newest = positions + (window - 1) * n, mean = 0.0, squares = 0.0;
    if (*count == 0 || time > times[window - 1]) {
        memmove(times, times + 1, (window - 1) * sizeof *times);
        memmove(positions, positions + n, (window - 1) * n * sizeof *positions);
        times[window - 1] = time;
        if (*count < window) ++*count;
    }
    memcpy(newest, reading, n * sizeof *newest);
    memset(rates, 0, n * sizeof *rates);
    if (*count < 2) return DONE;
    const double last = times[window - 1]; /* sums of the system's times would lose microseconds */
    for (int64_t k = window - *count; k < window; k++) mean += times[k] - last;
    mean /= (double)*count;
    for (int64_t k = window - *count; k < window; k++) squares += (times[k] - last - mean) * (times[k] - last - mean);
    for (int64_t k = window - *count; k < window; k++) {
        const double weight = (times[k] - last - mean) / squares;
        for (int64_t j = 0; j < n; j++) rates[j] += weight * positions[k * n + j];
    }
    return DONE;
}

double wbc_joint_motion(const wbc_estimator *e, int64_t joint, double from, double to) {
    return e->tree->kind[joint] == CONTINUOUS ? remainder(to - from, 2.0 * PI) : to - from;
}

void wbc_read_joints(const wbc_estimator *e, const wbc_memory *m, const wbc_sample *s, double dt, double *positions,
                     double *rates) {
    const int64_t n = e->tree->nv - 6;
    double *before = m->believed;
    memcpy(positions, s->positions, n * sizeof *positions);
    for (int64_t i = 2; m->counts[BELIEVES] && i < e->tree->joints; i++) { /* encoders begin anew after a turn */
        const int64_t j = e->tree->iv[i] - 6;
        if (e->tree->kind[i] == CONTINUOUS)
            positions[j] = before[j] + wbc_joint_motion(e, i, before[j], positions[j]);
    }
    for (int64_t j = 0; j < n; j++) {
        const int jumped = m->counts[BELIEVES] && fabs(positions[j] - before[j]) > e->fastest[j] * dt + LEEWAY;
        m->distrusted[j] = jumped ? m->distrusted[j] + 1 : 0;
        const int doubted = jumped && m->distrusted[j] < AGREE;
        if (doubted) wbc_report(e, JOINT_JUMPED, j, 0.0);
        else before[j] = positions[j];
    }
    m->counts[BELIEVES] = 1;
    wbc_joint_rates(e->window, n, m->times, m->positions, m->counts + READINGS, s->time, before, rates);
    if (s->velocities) memcpy(rates, s->velocities, n * sizeof *rates);
    for (int64_t j = 0; j < n; j++) positions[j] = before[j] + e->encoder_delay * rates[j];
}

static int is_in_range(const double *value, double most) {
    for (int i = 0; i < 3; i++)
        if (!(value[i] >= -most && value[i] <= most)) return 0;
    return 1;
}

/* Return the IMUs whose readings are accepted. */
static int64_t accepted_imus(const wbc_estimator *e, const wbc_memory *m, const wbc_sample *s) {
    int64_t found = 0;
    for (int64_t k = 0; k < e->imus; k++) {
        const double *reading = s->imu + 6 * k;
        if (!s->heard[k]) continue;
        m->same[k] = m->has[k] && !memcmp(m->last + 6 * k, reading, 6 * sizeof *reading) ? m->same[k] + 1 : 0;
        if (!is_in_range(reading, e->range[2 * k])) wbc_report(e, RATE_BEYOND, k, e->range[2 * k]);
        else if (!is_in_range(reading + 3, e->range[2 * k + 1])) wbc_report(e, FORCE_BEYOND, k, e->range[2 * k + 1]);
        else if (m->same[k] >= FROZEN) wbc_report(e, HANGS, k, (double)m->same[k]);
        else {
            m->heard[k] = s->time, m->has[k] = 1;
            memcpy(m->last + 6 * k, reading, 6 * sizeof *reading);
            found |= (int64_t)1 << k;
        }
    }
    return found;
}

static int64_t lowest_member(int64_t set) {
    int64_t k = 0;
    while (!HAS(set, k)) k++;
    return k;
}

int64_t wbc_imus_on_link(const wbc_estimator *e, int64_t leader) {
    int64_t set = 0;
    for (int64_t k = 0; k < e->imus; k++) set |= (int64_t)(e->joint[k] == e->joint[leader]) << k;
    return set;
}

/* The specific force is linear in the point of a body: the mean is that at the centre. */
void wbc_mean_of_imus(const wbc_estimator *e, int64_t leader, int64_t members, const double *readings, double *out) {
    const double *own = e->placement + 12 * leader;
    memcpy(out, readings + 6 * leader, 6 * sizeof *out);
    int64_t count = 1;
    for (int64_t k = 0; k < e->imus; k++) {
        double along[3], turned[3];
        if (k == leader || !HAS(members, k)) continue;
        count++;
        for (int part = 0; part < 6; part += 3) {
            times3(e->placement + 12 * k, readings + 6 * k + part, along);
            transposed_times3(own, along, turned);
            for (int i = 0; i < 3; i++) out[part + i] += turned[i];
        }
    }
    for (int i = 0; i < 6; i++) out[i] /= (double)count;
}

/* Replace silent IMUs: by the other members, else by one that was heard now, on another link. */
static void replace_silent_imus(const wbc_estimator *e, const wbc_memory *m, int64_t now, double time) {
    int64_t *leader = m->counts + LEADER, *members = m->counts + MEMBERS, left = 0;
    const int64_t silent = *leader;
    double latest = -INFINITY;
    for (int64_t k = 0; k < e->imus; k++)
        if (HAS(*members, k) && m->heard[k] > latest) latest = m->heard[k];
    for (int64_t k = 0; k < e->imus; k++)
        if (HAS(*members, k) && latest - m->heard[k] <= QUIET + ROUNDING) left |= (int64_t)1 << k;
    if (time - latest > e->timeout && now) {
        left = wbc_imus_on_link(e, lowest_member(now)) & now;
    } else
        for (int64_t k = 0; k < e->imus; k++)
            if (HAS(*members & ~left, k) && k != silent) wbc_report(e, LEFT_OUT, k, 1e3 * (time - m->heard[k]));
    *members = left;
    if (HAS(left, silent)) return;
    *leader = lowest_member(left);
    wbc_report(e, TAKES_OVER, silent * MOST_IMUS + *leader, 1e3 * (time - m->heard[silent]));
}

/* Write what to predict by over dt. A slow IMU's reading is the mean since its last one, which was held meanwhile: it
 * makes up for what both differ by. */
static void make_up(const wbc_memory *m, double dt, int silent, const double *reading, double *mean) {
    double *held = m->held;
    memcpy(mean, reading, 6 * sizeof *mean);
    for (int i = 0; i < 6; i++) {
        if (silent) held[1 + i] += dt * reading[i];
        else if (held[0] > 0.0) mean[i] += (held[0] * reading[i] - held[1 + i]) / dt;
    }
    held[0] += dt;
    if (!silent) memset(held, 0, 7 * sizeof *held);
}

int wbc_read_imus(const wbc_estimator *e, const wbc_memory *m, const wbc_sample *s, wbc_inertial *found) {
    double before[MOST_IMUS];
    memcpy(before, m->heard, e->imus * sizeof *before);
    const int64_t now = accepted_imus(e, m, s), led = m->counts[LEADER], were = m->counts[MEMBERS];
    replace_silent_imus(e, m, now, s->time);
    const int64_t leader = m->counts[LEADER], members = m->counts[MEMBERS];
    int64_t speaking = 0, count = 0;
    int broken = leader != led || members != were; /* what was held is not what the reading makes up for */
    double latest = -INFINITY, previous = -INFINITY, mean[6];
    for (int64_t k = 0; k < e->imus; k++) broken |= s->heard[k] && HAS(members & ~now, k); /* a refused one */
    for (int64_t k = 0; k < e->imus; k++)
        if (HAS(members, k) && m->has[k]) {
            speaking |= (int64_t)1 << k, count++;
            if (m->heard[k] > latest) latest = m->heard[k];
            if (before[k] > previous) previous = before[k];
        }
    if (!m->has[leader]) return NO_IMU;
    if (!(now & members) && s->time - latest > QUIET + ROUNDING)
        wbc_report(e, HELD, leader, 1e3 * (s->time - latest));
    wbc_mean_of_imus(e, leader, speaking, m->last, mean);
    memcpy(found->rate, mean, sizeof found->rate);
    memcpy(found->force, mean + 3, sizeof found->force);
    found->scale = (now & members ? 1.0 : GUESSED) / (double)count;
    const double gap = s->time - previous - (QUIET > 2.0 * *m->usual ? QUIET : 2.0 * *m->usual);
    if (broken || gap > ROUNDING) memset(m->held, 0, 7 * sizeof *m->held);
    make_up(m, s->time - *m->time, !broken && !(now & members), mean, found->mean);
    if (!(gap > ROUNDING)) return DONE;
    if (now & members) wbc_report(e, GAP, leader, 1e3 * (s->time - previous));
    if (e->filter->accelerometer > 0.0) found->scale += STRAYS * STRAYS * gap / e->filter->accelerometer;
    return DONE;
}
