/* The path of a foot in the air, whose goal and time of landing may change in every tick.
 *
 * Place, yaw and tilt, and the height's offset from its nominal curve, are on quintics that end at rest at the goal.
 * Of all that begin as the foot moves now these have the least integrated squared jerk (Flash & Hogan 1985), so one
 * that is asked for anew in every tick, with the goal unchanged, stays on its curve.
 */
#include "linear.h"
#include "core.h"

#include <string.h>

static const double LEAST_LEFT = 0.03; /* s: shortest remaining time of a quintic */
/* Exponent of s (1 - s) in a foot's height, while it goes ahead with s^3: the less, the sooner it is above an edge
 * just before its toe; at 2 and less its acceleration jumps. */
static const double STEEPNESS = 2.5;
/* A foot whose pace is outside of this, in a step made much shorter or longer, jumps to its descent speed when it is
 * late: pushed robots fell otherwise. */
static const double SLOWEST_USUAL = 0.5, FASTEST_USUAL = 1.1;
const double wbc_speed_up = 6.0, wbc_pitch_peak = 0.35;
static const double TURN = 6.283185307179586;
/* A foot of velocity v that comes to rest on a minimum-jerk curve within T, at an acceleration of at most a, gets
 * rest_range a T^2 away from v T/2, and needs T >= STOP_TIME v/a. (Extremes of 60 s - 180 s^2 + 120 s^3 and of
 * 6 s - 6 s^2.) */
const double wbc_rest_range = 0.17320508075688773; /* sqrt(3)/10 */
static const double STOP_TIME = 1.5;
/* m: a foot whose landing is put off may go so far past its goal, and come back. */
static const double PASSING = 0.02;

typedef struct {
    double value, rate, acceleration;
} motion;

/* The smoothest way from 0 to 1 between rest and rest, at a part s of its time: 10 s^3 - 15 s^4 + 6 s^5. */
static motion minimum_jerk(double s) {
    const double b = s * (1.0 - s);
    const motion out = {s * s * s * (10.0 + s * (6.0 * s - 15.0)), 30.0 * b * b, 60.0 * b * (1.0 - 2.0 * s)};
    return out;
}

/* The motions (3, n) dt later on the quintics that end at rest at the goals (n) after left; out may be now. */
int wbc_towards(int64_t n, double left, double dt, const double *now, const double *goal, double *out) {
    const double T = left > LEAST_LEFT ? left : LEAST_LEFT, s = dt < T ? dt / T : 1.0;
    const double c = 1.0 - s, Ts = T * s, c3 = c * c * c;
    const motion curve = minimum_jerk(s);
    for (int64_t i = 0; i < n; i++) { /* Hermite polynomials of degree 5, and their derivatives */
        const double d = goal[i] - now[i], v = now[n + i], a = now[2 * n + i];
        out[i] = now[i] + (curve.value * d + Ts * c3 * (1.0 + 3.0 * s) * v + 0.5 * Ts * Ts * c3 * a);
        out[n + i] =
            curve.rate / T * d + c * c * (1.0 + 2.0 * s - 15.0 * s * s) * v + 0.5 * Ts * c * c * (2.0 - 5.0 * s) * a;
        out[2 * n + i] = curve.acceleration / (T * T) * d - 12.0 / T * s * c * (3.0 - 5.0 * s) * v +
                         c * (1.0 - 8.0 * s + 10.0 * s * s) * a;
    }
    return 0;
}

/* A curve from 0 to size at s = top and to 0 at s = 1, with the rate of s [1/s]; its curvature is 0 at all three. */
static motion bump(double s, double rate, double top, double size) {
    const double scale = s < top ? 1.0 / top : -1.0 / (1.0 - top);
    motion out = minimum_jerk(s < top ? s / top : (1.0 - s) / (1.0 - top));
    out.value *= size, out.rate *= size * scale * rate, out.acceleration *= size * scale * rate * scale * rate;
    return out;
}

/* From one height to the other on the smoothest way, and up and down meanwhile: the bump is 1 in the middle, and
 * its value, slope and curvature vanish at both ends. */
static motion lift(double start, double end, double clearance, double s, double rate) {
    const double y = 4.0 * s * (1.0 - s), tilt = 4.0 * (1.0 - 2.0 * s), n = STEEPNESS, d = end - start;
    const double steep = n * pow(y, n - 1.0), bend = n * (n - 1.0) * pow(y, n - 2.0) * tilt * tilt - 8.0 * steep;
    motion out = minimum_jerk(s);
    out.value = start + d * out.value + clearance * pow(y, n);
    out.rate = (d * out.rate + clearance * steep * tilt) * rate;
    out.acceleration = (d * out.acceleration + clearance * bend) * rate * rate;
    return out;
}

/* The nominal height over ground at the goal, at a rate of done [1/s]; 0: the foot is late, and goes on down. */
static motion nominal_height(const wbc_swing_path *path, const wbc_swing_foot *foot, double ground, double rate) {
    if (rate == 0.0) {
        motion down = {ground - path->descent * foot->late, -path->descent, 0.0};
        if (foot->pace < SLOWEST_USUAL || foot->pace > FASTEST_USUAL) return down;
        const double most = path->descent / wbc_speed_up, speeding = foot->late < most ? foot->late : most;
        const double v = wbc_speed_up * speeding;
        down.value = ground - (0.5 * v * speeding + v * (foot->late - speeding)), down.rate = -v;
        down.acceleration = v < path->descent ? -wbc_speed_up : 0.0;
        return down;
    }
    if (path->crosses) {
        const double low = foot->done < 0.5 ? path->start : ground;
        motion over = bump(foot->done, rate, 0.5, path->top - low);
        over.value += low;
        return over;
    }
    /* In a shortened step the clearance falls with the square of the time. */
    const double pace = rate * path->usual, part = pace > 1.0 ? 1.0 / (pace * pace) : 1.0;
    return lift(path->start, ground, part * path->clearance, foot->done, rate);
}

/* position (3), rotation (3, 3), twist (6) and its derivative (6); rates are of first order in the tilt. */
static void write_pose(const wbc_swing_foot *foot, motion tip, double *pose) {
    const double *place = foot->level[0], nx = place[3], ny = place[4], nz = sqrt(1.0 - nx * nx - ny * ny);
    const double a = 1.0 / (1.0 + nz), c = cos(place[2]), s = sin(place[2]), C = cos(tip.value), S = sin(tip.value);
    /* The shortest rotation that takes the vertical to the normal; heading; and toe down. */
    const double tilt[9] = {1.0 - a * nx * nx, -a * nx * ny, nx, -a * nx * ny, 1.0 - a * ny * ny, ny, -nx, -ny, nz};
    const double turn[9] = {c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0}, pitch[9] = {C, 0.0, S, 0.0, 1.0, 0.0, -S, 0.0, C};
    double R[9], *twist = pose + 12;
    product3(tilt, turn, R);
    product3(R, pitch, pose + 3);
    pose[0] = place[0], pose[1] = place[1], pose[2] = foot->height[0];
    for (int order = 1; order < 3; order++, twist += 6) {
        const double *rate = foot->level[order], pitching = order == 1 ? tip.rate : tip.acceleration;
        twist[0] = rate[0], twist[1] = rate[1], twist[2] = foot->height[order];
        twist[3] = -rate[4], twist[4] = rate[3], twist[5] = rate[2];
        for (int i = 0; i < 3; i++) twist[3 + i] += pitching * R[3 * i + 1];
    }
}

double wbc_rest_time(double most, const double *place, const double *rate, const double *lower, const double *upper) {
    const double k = wbc_rest_range * most;
    double shortest = STOP_TIME * fmax(fabs(rate[0]), fabs(rate[1])) / most;
    for (int side = 0; side < 4; side++) {
        const int axis = side % 2;
        const double missing = side < 2 ? lower[axis] - place[axis] : place[axis] - upper[axis];
        const double b = side < 2 ? 0.5 * rate[axis] : -0.5 * rate[axis];
        const double discriminant = b * b + 4.0 * k * missing; /* of k T^2 + b T >= missing; negative: always */
        if (discriminant > 0.0) shortest = fmax(shortest, (sqrt(discriminant) - b) / (2.0 * k));
    }
    return shortest;
}

/* The time, at most left, within which a foot stops at a distance d. The slope of a minimum-jerk curve just before its
 * end is proportional to 30 d - 12 v T - 1.5 a T^2: with the least T of no slope it does not pass its goal, for v > 0. */
static double stopping_time(double d, double v, double a, double left, double most) {
    const double sign = v < 0.0 ? -1.0 : 1.0, room = fmax(sign * d, 0.0) + PASSING;
    const double slow = 12.0 * fabs(v), inside = slow * slow + 180.0 * sign * a * room;
    if (inside < 0.0) return left; /* it is slowed down enough */
    const double straight = 60.0 * room / fmax(slow + sqrt(inside), 1e-9);
    if (straight >= left) return left;
    const double from[2] = {0.0, 0.0}, rate[2] = {v, 0.0}, at[2] = {d, 0.0};
    return fmin(left, fmax(straight, wbc_rest_time(most, from, rate, at, at)));
}

/* Stop a foot sooner, on each of its axes, where it would pass its goal. One that is to land at once and then is given
 * time, as the DCM turns back, would follow its curve to the other side of the standing foot, and come back: legs were
 * crossed so. */
static void stop_at_goal(const double *end, double left, double dt, double most, const double before[3][5],
                         double after[3][5]) {
    for (int axis = 0; axis < 2; axis++) {
        const double x = axis ? -sin(end[2]) : cos(end[2]), y = axis ? cos(end[2]) : sin(end[2]);
        const double d = x * (end[0] - before[0][0]) + y * (end[1] - before[0][1]);
        const double along[3] = {0.0, x * before[1][0] + y * before[1][1], x * before[2][0] + y * before[2][1]};
        const double time = stopping_time(d, along[1], along[2], left, most);
        if (time >= left) continue;
        double sooner[3], later[3];
        wbc_towards(1, time, dt, along, &d, sooner);
        wbc_towards(1, left, dt, along, &d, later);
        for (int order = 0; order < 3; order++) {
            after[order][0] += x * (sooner[order] - later[order]),
                after[order][1] += y * (sooner[order] - later[order]);
        }
    }
}

int wbc_swing(const wbc_swing_path *path, double x, double y, double yaw, double ground, double left, double dt,
              double most, const wbc_swing_foot *before, wbc_swing_foot *foot, double *pose) {
    const double rate = (1.0 - before->done) / (left > dt ? left : dt), heading = before->level[0][2];
    const double end[5] = {x, y, heading + remainder(yaw - heading, TURN), path->normal[0], path->normal[1]};
    motion tip = {0.0, 0.0, 0.0};
    *foot = *before;
    if (!path->crosses) {
        wbc_towards(5, left, dt, before->level[0], end, foot->level[0]);
        stop_at_goal(end, left, dt, most, before->level, foot->level);
    } else if (before->done >= path->begins)
        wbc_towards(5, rate ? left - path->ends / rate : 0.0, dt, before->level[0], end, foot->level[0]);
    if (left > 0.0) {
        foot->done = before->done + rate * dt < 1.0 ? before->done + rate * dt : 1.0;
        if (left >= dt) foot->pace = rate * path->usual;
    } else foot->done = 1.0, foot->late += dt;
    if (path->crosses) tip = bump(foot->done, rate, wbc_pitch_peak, path->tip);
    const motion was = nominal_height(path, before, ground, rate), is = nominal_height(path, foot, ground, rate);
    const double off[3] = {before->height[0] - was.value, before->height[1] - was.rate,
                           before->height[2] - was.acceleration};
    const double none = 0.0;
    wbc_towards(1, left, dt, off, &none, foot->height); /* the offset decays until touch-down */
    foot->height[0] += is.value, foot->height[1] += is.rate, foot->height[2] += is.acceleration;
    write_pose(foot, tip, pose);
    return 0;
}
