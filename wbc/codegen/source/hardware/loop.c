/* The loop on a robot, without Python: ./loop SECONDS [ADDRESS [SLOWER [DOMAIN]]]
 *
 * 500 times a second: read, check, estimate, compute the command of the mode, judge faults, limit, write; as
 * wbc/hardware/loop.py, but in one thread: a tick that takes too long is a late cycle. It arms, stands up, lets the
 * controller run for SECONDS, sits down and ends. Against the simulated robot of
 *
 *     wbc hardware sim g1 --bus udp
 *
 * SLOWER: factor of slow motion, as the simulator's --slower; DOMAIN likewise. Exit code 0: it sat down as asked; 3:
 * a fault stopped it; 1: there is no robot. Unlike Python's loop it does not check that the feet bear the weight: the
 * robot must stand on the ground. On a real robot a person arms: replace request_mode.
 */
#define _POSIX_C_SOURCE 200112L
#include "../controller.h"
#include "checks.h"
#include "linear.h"
#include "sensing.h"
#include "udp.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static const double SILENT_AFTER = 0.005, GONE_AFTER = 0.040, STALL = 0.040; /* s; as in Python */
static const double UNBALANCED = 1.5;                                        /* s up without an estimate; likewise */
static const double SETTLE = 0.5;                                            /* s in damping, at both ends */
static const double FIRST = 10.0; /* s: the robot must have been heard by then */
enum { STOPS = 5 };
#define EVERY ((int)(WBC_DT / WBC_CYCLE + 0.5)) /* cycles of a tick */

/* A motion up or down along the postures of the crouch, first onto them from where joints are. */
typedef struct {
    int up, begun;
    double began, from[WBC_JOINTS], loaded[WBC_JOINTS], first;
} posture_path;

typedef struct {
    wbc_udp bus;
    wbc_safety safety;
    wbc_checks checks;
    wbc_sensing sensing;
    wbc_controller controller;
    posture_path to_stand, to_crouch;
    wbc_reading reading, before;
    int has_reading, has_before, mode, was_up, estimates, asked, runs, turn, faulted;
    double time, mode_began, heard, estimate[WBC_ESTIMATE];
    double held[WBC_JOINTS], turned[9], shift[3], began; /* from the estimate's world to the problem's */
    wbc_motors command;
    uint64_t sent;
} robot_loop;

/* ---- time ---- */

static double slower = 1.0;

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return ((double)t.tv_sec + 1e-9 * (double)t.tv_nsec) / slower;
}

static void sleep_until(double due) {
    const double seconds = due * slower;
    struct timespec t;
    t.tv_sec = (time_t)seconds, t.tv_nsec = (long)(1e9 * (seconds - (double)t.tv_sec));
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, 0) == EINTR) {
    }
}

/* ---- up and down ---- */

static double minimum_jerk(double x) {
    x = x < 0.0 ? 0.0 : x > 1.0 ? 1.0 : x;
    return x * x * x * (10.0 + x * (6.0 * x - 15.0));
}

static void begin_path(posture_path *w, double time, const wbc_reading *r, const wbc_motors *last) {
    double least = INFINITY;
    w->begun = 1, w->began = time, w->first = WBC_POSTURES - 1;
    wbc_motor_torque(last, r->position, r->velocity, w->loaded);
    memcpy(w->from, r->position, sizeof w->from);
    for (int k = 0; !w->up && k < WBC_POSTURES; k++) { /* the nearest posture */
        double off = 0.0;
        for (int j = 0; j < WBC_JOINTS; j++)
            off += (wbc_crouch[k][j] - r->position[j]) * (wbc_crouch[k][j] - r->position[j]);
        if (off < least) least = off, w->first = k;
    }
}

static int is_over(const posture_path *w, double time) { return w->begun && time - w->began >= WBC_ONTO + WBC_ALONG; }

static void path_command(const posture_path *w, double time, wbc_motors *c) {
    const double onto = minimum_jerk((time - w->began) / WBC_ONTO);
    const double along = minimum_jerk((time - w->began - WBC_ONTO) / WBC_ALONG);
    const double at = w->first + along * ((w->up ? 0.0 : WBC_POSTURES - 1.0) - w->first);
    const int low = (int)at < WBC_POSTURES - 2 ? (int)at : WBC_POSTURES - 2;
    const double part = at - low;
    for (int j = 0; j < WBC_JOINTS; j++) {
        const double posture = (1.0 - part) * wbc_crouch[low][j] + part * wbc_crouch[low + 1][j];
        const double torque = (1.0 - part) * wbc_bearing[low][j] + part * wbc_bearing[low + 1][j];
        c->position[j] = (1.0 - onto) * w->from[j] + onto * posture, c->velocity[j] = 0.0;
        c->torque[j] = (1.0 - onto) * w->loaded[j] + onto * torque;
        c->kp[j] = wbc_stiffness[j], c->kd[j] = wbc_holding[j];
    }
    c->enabled = 1;
}

/* ---- estimate and tick ---- */

static int sense(robot_loop *l) {
    static const int64_t heard[1] = {1};
    const wbc_reading *r = &l->reading;
    double imu[6] = {r->rate[0], r->rate[1], r->rate[2], r->force[0], r->force[1], r->force[2]};
    const wbc_sample sample = {.time = r->time,
                               .positions = r->position,
                               .velocities = r->velocity,
                               .torques = r->torque,
                               .imu = imu,
                               .heard = heard};
    return wbc_sensing_take(&l->sensing, &sample, l->estimate);
}

/* Start the controller: find the transformation of the estimate's soles to where the problem begins. */
static void begin(robot_loop *l) {
    const double *q = l->estimate + WBC_AT_Q;
    const wbc_estimator *e = &l->sensing.estimator;
    double R[9], ahead[2] = {0.0, 0.0}, middle[3] = {q[0], q[1], q[2]}, moved[3];
    from_quaternion(q + 3, R);
    for (int k = 0; k < WBC_FEET; k++) { /* frames are relative to the base */
        const double *sole = e->frames + (WBC_IMUS + k) * FRAME_SIZE(WBC_NV), *S = sole + FRAME_ROTATION;
        const double x[3] = {S[0], S[3], S[6]};
        for (int i = 0; i < 3; i++) middle[i] += dot3(R + 3 * i, sole) / WBC_FEET;
        for (int i = 0; i < 2; i++) ahead[i] += dot3(R + 3 * i, x);
    }
    const double by = wbc_begin_heading - atan2(ahead[1], ahead[0]);
    const double turned[9] = {cos(by), -sin(by), 0.0, sin(by), cos(by), 0.0, 0.0, 0.0, 1.0};
    memcpy(l->turned, turned, sizeof turned);
    times3(turned, middle, moved);
    for (int i = 0; i < 3; i++) l->shift[i] = wbc_begin_stance[i] - moved[i];
    l->began = l->reading.time;
    memcpy(l->held, l->reading.position, sizeof l->held);
}

/* Write the command of a tick; 0: it has none. */
static int tick(robot_loop *l, wbc_motors *c) {
    double q[WBC_NQ], moved[3];
    const double *v = l->estimate + WBC_AT_V, z = atan2(l->turned[3], l->turned[0]);
    wbc_command found;
    memcpy(q, l->estimate + WBC_AT_Q, sizeof q);
    times3(l->turned, q, moved);
    for (int i = 0; i < 3; i++) q[i] = moved[i] + l->shift[i];
    const double x[4] = {q[3], q[4], q[5], q[6]}, s = sin(0.5 * z), w = cos(0.5 * z); /* turned about z */
    q[3] = w * x[0] - s * x[1], q[4] = w * x[1] + s * x[0], q[5] = w * x[2] + s * x[3], q[6] = w * x[3] - s * x[2];
    if (wbc_control(&l->controller, q, v, &found) != DONE) return 0;
    const double left = 1.0 - (l->reading.time - l->began) / WBC_FADE;
    for (int j = 0; j < WBC_JOINTS; j++) {
        c->position[j] = l->held[j], c->velocity[j] = found.velocity[6 + j], c->torque[j] = found.torque[j];
        c->kp[j] = left > 0.0 ? left * wbc_stiffness[j] : 0.0, c->kd[j] = wbc_following[j];
    }
    c->enabled = 1;
    return 1;
}

/* ---- one cycle ---- */

static int listen(robot_loop *l) {
    wbc_reading came;
    if (wbc_udp_read(&l->bus, &came)) {
        const int refused = wbc_checks_refused(&l->checks, &came, l->time);
        if (refused >= 0) wbc_safety_report(&l->safety, refused);
        else {
            l->before = l->reading, l->has_before = l->has_reading;
            l->reading = came, l->has_reading = 1, l->heard = l->time;
            return 1;
        }
    }
    if (l->has_reading && l->time - l->heard > SILENT_AFTER) wbc_safety_report(&l->safety, WBC_FAULT_SILENT);
    return 0;
}

static void entered(robot_loop *l) {
    const wbc_safety *s = &l->safety;
    struct pollfd out = {1, POLLOUT, 0}; /* a stopped terminal must not block a cycle */
    if (poll(&out, 1, 0) == 1)
        printf("%9.3f s  %s%s%s\n", l->time, wbc_mode_names[s->mode], s->cause >= 0 ? ": " : "",
               s->cause >= 0 ? wbc_fault_names[s->cause] : "");
    l->mode = s->mode, l->mode_began = l->time, l->runs = 0, l->faulted |= s->cause >= 0;
    if (s->mode != WBC_MODE_STANDING_UP) return;
    l->to_stand.begun = l->to_crouch.begun = l->estimates = l->asked = 0;
    l->was_up = 1; /* or on its way: after a stop it does not try again */
}

/* Request the next mode when it is due; returns whether the program is over. */
static int request_mode(robot_loop *l, double seconds) {
    wbc_safety *s = &l->safety;
    const double passed = l->time - l->mode_began;
    const int is_up = is_over(&l->to_stand, l->time) && l->estimates;
    if (s->mode == WBC_MODE_IDLE && l->has_reading && !l->was_up) wbc_safety_arm(s);
    else if (s->mode == WBC_MODE_DAMPING && passed > SETTLE) {
        if (l->was_up) return 1;
        wbc_safety_stand_up(s);
    } else if (s->mode == WBC_MODE_STANDING_UP && is_up) wbc_safety_to(s, WBC_MODE_RUNNING);
    else if (s->mode == WBC_MODE_STANDING_UP && is_over(&l->to_stand, l->time - UNBALANCED))
        wbc_safety_to(s, WBC_MODE_SOFT_STOP), l->faulted = 1; /* no estimate: it leans, without balance */
    else if (s->mode == WBC_MODE_RUNNING && passed > seconds) wbc_safety_to(s, WBC_MODE_SOFT_STOP);
    else if (s->mode == WBC_MODE_SOFT_STOP && is_over(&l->to_crouch, l->time)) wbc_safety_to(s, WBC_MODE_DAMPING);
    else if (s->mode == WBC_MODE_STOP && passed > SETTLE) return 1;
    if (s->mode != l->mode) s->cause = -1, entered(l);
    return 0;
}

/* Return the command of this mode, or 0: repeat the last one. */
static const wbc_motors *mode_command(robot_loop *l, int fresh, wbc_motors *c) {
    wbc_safety *s = &l->safety;
    if (!l->has_reading) return 0;
    posture_path *w = s->mode == WBC_MODE_STANDING_UP ? &l->to_stand
                      : s->mode == WBC_MODE_SOFT_STOP ? &l->to_crouch
                                                      : 0;
    if (w) {
        if (!w->begun) begin_path(w, l->time, &l->reading, &l->command);
        path_command(w, l->time, c);
    }
    const int stands = s->mode == WBC_MODE_STANDING_UP && is_over(w, l->time), runs = s->mode == WBC_MODE_RUNNING;
    if (!fresh || !(stands || runs)) return w ? c : 0;
    if (stands && !l->asked++) wbc_sensing_start(&l->sensing);
    const int status = sense(l);
    l->estimates = status == DONE;
    if (status != DONE && (runs || status != STANDING)) wbc_safety_report(s, WBC_FAULT_ESTIMATOR_FAILED);
    if (!runs) return c;
    if (status != DONE) return 0;
    if (!l->runs) begin(l), l->runs = 1, l->turn = EVERY;
    if (++l->turn < EVERY) return 0;
    l->turn = 0;
    if (tick(l, c)) return c;
    wbc_safety_report(s, WBC_FAULT_TICK_FAILED);
    return 0;
}

static void cycle(robot_loop *l, double late) {
    wbc_safety *s = &l->safety;
    double torque[WBC_JOINTS];
    wbc_motors c;
    if (late > STALL) wbc_safety_report(s, WBC_FAULT_STALLED);
    else if (late > WBC_CYCLE) wbc_safety_report(s, WBC_FAULT_LATE_CYCLE);
    const int fresh = listen(l);
    if (fresh) {
        const int knows = l->has_before && l->command.enabled;
        if (knows) wbc_motor_torque(&l->command, l->before.position, l->before.velocity, torque);
        wbc_checks_compared(&l->checks, &l->reading, knows ? torque : 0, s);
        wbc_safety_measured(s, &l->reading);
    }
    const wbc_motors *told = mode_command(l, fresh, &c);
    if (wbc_safety_judge(s) != l->mode) {
        entered(l);
        told = mode_command(l, 0, &c);
    }
    l->command = *wbc_safety_admit(s, told);
    if (!wbc_udp_write(&l->bus, &l->command, ++l->sent)) wbc_safety_report(s, WBC_FAULT_BUS_FAILED);
}

int main(int count, char **arguments) {
    static robot_loop l;
    const double seconds = count > 1 ? atof(arguments[1]) : 5.0;
    const char *address = count > 2 ? arguments[2] : "127.0.0.1", *ended = 0;
    slower = count > 3 ? atof(arguments[3]) : 1.0;
    setvbuf(stdout, 0, _IOLBF, 0);
    signal(SIGPIPE, SIG_IGN); /* a closed pipe must not end the loop */
    if (!wbc_udp_open(&l.bus, address, count > 4 ? atoi(arguments[4]) : 0)) {
        fprintf(stderr, "no bus to %s: is another controller running?\n", address);
        return 1;
    }
    wbc_safety_start(&l.safety), wbc_checks_start(&l.checks), wbc_sensing_start(&l.sensing);
    wbc_start(&l.controller);
    l.to_stand.up = 1;
    double due = now();
    const double start = due;
    int64_t cycles = 0, late_ones = 0;
    while (!ended) {
        sleep_until(due);
        l.time = now();
        const double late = l.time - due;
        due += WBC_CYCLE * (1 + (int64_t)(late / WBC_CYCLE));
        cycles++, late_ones += late > 2e-4;
        cycle(&l, late);
        if (request_mode(&l, seconds)) ended = "it is down";
        if (l.has_reading && l.time - l.heard > GONE_AFTER) ended = "the robot's side is gone";
        if (!l.has_reading && l.time - start > FIRST) ended = "no robot was heard";
    }
    const int stopped =
        l.faulted || l.safety.mode == WBC_MODE_STOP || (l.has_reading && l.time - l.heard > GONE_AFTER);
    wbc_safety_stop(&l.safety);
    for (int k = 0; k < STOPS; k++) wbc_udp_write(&l.bus, wbc_safety_admit(&l.safety, 0), ++l.sent);
    printf("%s; %lld cycles, %.2f %% of them within 0.2 ms\n", ended, (long long)cycles,
           100.0 - 100.0 * (double)late_ones / (double)cycles);
    for (int f = 0; f < WBC_FAULTS; f++)
        if (l.safety.counts[f]) printf("%6lld cycles: %s\n", (long long)l.safety.counts[f], wbc_fault_names[f]);
    return !l.has_reading ? 1 : stopped ? 3 : 0;
}
