/* The base's state from IMUs, encoders and contacts, message by message:
 * IMU -> predict -> joints -> feet seen from the IMU -> loads -> hold, correct by or release each foot
 *     -> base pose and velocity -> external forces by momentum residuals, for the next message's loads */
#include "estimator.h"
#include "rotation.h"
#include "tree.h"

static const double STILL =
    0.1; /* rad/s: a robot whose mean rate, or that of a joint, is above does not stand still */

int wbc_estimator_sizes(const wbc_estimator *e, int64_t *sizes) {
    const int64_t n = e->tree->nv - 6, imus = e->imus, feet = e->feet;
    sizes[0] = 10 + e->window * (n + 1) + n + 7 * imus + feet * (3 + feet);
    sizes[1] = FEET_STAND + 4 * feet + 2 * imus + n;
    sizes[2] = e->waiting * WAIT_SIZE(n, imus, feet);
    sizes[3] = 2 * (4 * imus + n + 2 * feet + 3);
    sizes[4] = OUT_WRENCHES + 6 * feet + e->tree->nv;
    sizes[5] = (imus + feet + 1) * FRAME_SIZE(e->tree->nv);
    return DONE;
}

wbc_memory wbc_memory_of(const wbc_estimator *e) {
    const int64_t n = e->tree->nv - 6, imus = e->imus, feet = e->feet;
    wbc_memory m;
    m.time = e->x, m.lost_since = m.time + 1;
    m.usual = m.lost_since + 1, m.times = m.usual + 1, m.positions = m.times + e->window;
    m.believed = m.positions + e->window * n;
    m.heard = m.believed + n, m.last = m.heard + imus;
    m.held = m.last + 6 * imus, m.since = m.held + 7, m.moves = m.since + feet, m.pace = m.moves + feet,
    m.apart = m.pace + feet;
    m.counts = e->counts;
    m.stands = m.counts + FEET_STAND, m.slips = m.stands + feet, m.bears = m.slips + feet;
    m.strikes = m.bears + feet, m.has = m.strikes + feet, m.same = m.has + imus, m.distrusted = m.same + imus;
    return m;
}

void wbc_report(const wbc_estimator *e, int64_t kind, int64_t whose, double how_much) {
    const int64_t k = e->event[0]++;
    e->event[1 + 2 * k] = kind, e->event[2 + 2 * k] = whose, e->detail[k] = how_much;
}

/* The frame of the IMU in use: the leader's axes, at the centre of all members. */
static void place_imu(const wbc_estimator *e, int64_t leader, int64_t members) {
    const int64_t nv = e->tree->nv, size = FRAME_SIZE(nv);
    double *out = e->frames + (e->imus + e->feet) * size;
    int64_t count = 1;
    memcpy(out, e->frames + leader * size, size * sizeof *out);
    for (int64_t k = 0; k < e->imus; k++) {
        const double *other = e->frames + k * size;
        if (k == leader || !HAS(members, k)) continue;
        count++;
        for (int i = 0; i < 3; i++) out[i] += other[i];
        for (int64_t i = 0; i < 3 * nv; i++) out[FRAME_JACOBIAN + i] += other[FRAME_JACOBIAN + i];
    }
    if (count == 1) return;
    for (int i = 0; i < 3; i++) out[i] /= (double)count;
    for (int64_t i = 0; i < 3 * nv; i++) out[FRAME_JACOBIAN + i] /= (double)count;
}

static void write_positions(const wbc_tree *tree, const double *positions, double *q) {
    for (int64_t j = 2; j < tree->joints; j++) {
        const double at = positions[tree->iv[j] - 6];
        double *to = q + tree->iq[j];
        if (tree->kind[j] == CONTINUOUS) to[0] = cos(at), to[1] = sin(at);
        else to[0] = at;
    }
}

void wbc_place_frames(const wbc_estimator *e, const wbc_memory *m, const double *positions) {
    const int64_t nv = e->tree->nv, nq = configuration_size(e->tree);
    double *q = e->scratch, *v = q + nq, *rest = v + nv;
    memset(q, 0, (nq + nv) * sizeof *q);
    q[6] = 1.0; /* the base at the origin, upright */
    write_positions(e->tree, positions, q);
    wbc_state(e->tree, q, v, e->state, rest, 0, 0, 0);
    wbc_frames(e->tree, e->state, e->imus + e->feet, e->joint, e->placement, e->frames);
    place_imu(e, m->counts[LEADER], m->counts[MEMBERS]);
}

/* Go on with other IMUs of the same body. If some stay, the mean's biases are the best guess; else the biases are
 * unknown. */
static void switch_imu(const wbc_estimator *e, const wbc_memory *m, int64_t leader, int64_t members) {
    const int64_t size = FRAME_SIZE(e->tree->nv), stays = m->counts[MEMBERS] & members;
    const double *imu = e->frames + (e->imus + e->feet) * size, *R = e->filter->x;
    double own[9], turned[9], old[3], arm[3], along[3], biases[6] = {0.0};
    memcpy(old, imu, sizeof old);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) own[3 * i + j] = dot3(R + 3 * i, imu + FRAME_ROTATION + 3 * j);
    place_imu(e, m->counts[LEADER], m->counts[MEMBERS]);
    for (int i = 0; i < 3; i++) along[i] = imu[i] - old[i];
    times3(own, along, arm);
    product3(own, imu + FRAME_ROTATION, turned);
    for (int part = 0; stays && part < 6; part += 3) {
        times3(e->placement + 12 * leader, e->filter->x + FILTER_GYRO + part, along);
        transposed_times3(e->placement + 12 * m->counts[LEADER], along, biases + part);
    }
    wbc_filter_follow(e->filter, arm, turned, biases, e->bias_variances, STILL * STILL);
}

/* Process a message. */
static int process(const wbc_estimator *e, const wbc_memory *m, const wbc_sample *s, int standing, double *out) {
    const wbc_tree *tree = e->tree;
    const int64_t nv = tree->nv, n = nv - 6, leader = m->counts[LEADER], members = m->counts[MEMBERS];
    double *v = out + OUT_WRENCHES + 6 * e->feet, *q = v + nv;
    double *positions = e->scratch + configuration_size(tree) + 18 * nv + 13 * tree->joints, *rates = positions + n;
    wbc_inertial now;
    e->event[0] = 0;
    int status = wbc_read_imus(e, m, s, &now);
    if (status != DONE) return status;
    const double dt = s->time - *m->time;
    *m->time = s->time;
    if (m->counts[LEADER] != leader || m->counts[MEMBERS] != members) {
        const int64_t next = m->counts[LEADER], those = m->counts[MEMBERS];
        m->counts[LEADER] = leader, m->counts[MEMBERS] = members;
        wbc_place_frames(e, m, m->believed); /* where the filter is: the messages in between moved the frames */
        m->counts[LEADER] = next, m->counts[MEMBERS] = those;
        switch_imu(e, m, leader, members);
    }
    wbc_read_joints(e, m, s, dt, positions, rates);
    if (dt > 0.0) wbc_filter_predict(e->filter, now.mean, now.mean + 3, dt, now.scale);
    if (dt > e->lost && dt > 2.0 * *m->usual) wbc_release_feet(e, m);
    wbc_place_frames(e, m, positions);
    status = wbc_update_feet(e, m, s, now.rate, rates, standing, out + OUT_SQUARED);
    if (status != DONE) return status;
    wbc_filter_base(e->filter, nv, e->frames + (e->imus + e->feet) * FRAME_SIZE(nv), now.rate, rates, q, v);
    write_positions(tree, positions, q);
    m->counts[FEELS] = s->torques != 0;
    if (s->torques) wbc_momentum_update(e->momentum, q, v, s->torques, dt);
    wbc_filter_covariance(e->filter, out);
    memcpy(out + OUT_GYRO, e->filter->x + FILTER_GYRO, 6 * sizeof *out);
    memcpy(out + OUT_WRENCHES, e->momentum->wrenches, 6 * e->feet * sizeof *out);
    double sum = 0.0; /* NaN if any entry is NaN or infinite */
    for (int64_t i = 0; i < 7; i++) sum += 0.0 * q[i];
    for (int64_t i = 0; i < 6; i++) sum += 0.0 * v[i];
    return sum == 0.0 ? DONE : NO_ESTIMATE;
}

static void clear(const wbc_estimator *e, const wbc_memory *m, double time) {
    const int64_t waits = m->counts[WAITS], nv = e->tree->nv;
    int64_t sizes[6];
    wbc_estimator_sizes(e, sizes);
    memset(e->x, 0, sizes[0] * sizeof *e->x);
    memset(e->counts, 0, sizes[1] * sizeof *e->counts);
    *m->time = time, *m->lost_since = INFINITY, m->counts[WAITS] = waits;
    for (int64_t k = 0; k < e->imus; k++) m->heard[k] = time;
    for (int64_t k = 0; k < e->feet; k++) m->moves[k] = INFINITY;
    for (int64_t k = 0; k < e->feet * e->feet; k++) m->apart[k] = NAN;
    memset(e->momentum->residual, 0, nv * sizeof(double));
    memset(e->momentum->velocity, 0, nv * sizeof(double));
    memset(e->momentum->wrenches, 0, 6 * e->feet * sizeof(double));
    e->momentum->known[0] = 0.0;
}

int wbc_estimator_reset(const wbc_estimator *e) {
    const wbc_memory m = wbc_memory_of(e);
    m.counts[WAITS] = 0, e->event[0] = 0;
    clear(e, &m, 0.0);
    return DONE;
}

/* ---- before the estimate begins, messages are stored; they are processed once the robot stood long enough ---- */

static void store_sample(const wbc_estimator *e, const wbc_sample *s, double *to) {
    const int64_t n = e->tree->nv - 6;
    double *joints = to + 4, *imu = joints + 3 * n, *heard = imu + 6 * e->imus, *loads = heard + e->imus;
    to[0] = s->time, to[1] = s->velocities != 0, to[2] = s->torques != 0, to[3] = s->loads != 0;
    memcpy(joints, s->positions, n * sizeof *to);
    if (s->velocities) memcpy(joints + n, s->velocities, n * sizeof *to);
    if (s->torques) memcpy(joints + 2 * n, s->torques, n * sizeof *to);
    for (int64_t k = 0; k < e->imus; k++)
        if ((heard[k] = (double)s->heard[k]) != 0.0) memcpy(imu + 6 * k, s->imu + 6 * k, 6 * sizeof *to);
    if (s->loads) memcpy(loads, s->loads, e->feet * sizeof *to);
}

static wbc_sample stored_sample(const wbc_estimator *e, const double *from, int64_t *heard) {
    const int64_t n = e->tree->nv - 6;
    const double *joints = from + 4, *imu = joints + 3 * n, *spoke = imu + 6 * e->imus;
    wbc_sample s = {from[0],
                    joints,
                    from[1] != 0.0 ? joints + n : 0,
                    from[2] != 0.0 ? joints + 2 * n : 0,
                    from[3] != 0.0 ? spoke + e->imus : 0,
                    imu,
                    heard};
    for (int64_t k = 0; k < e->imus; k++) heard[k] = spoke[k] != 0.0;
    return s;
}

/* Write the IMUs' mean readings (imus, 6); returns those to use: the first, and those on its link that were heard
 * at least half as often. */
static int64_t mean_readings(const wbc_estimator *e, int64_t count, double *readings) {
    const int64_t n = e->tree->nv - 6, size = WAIT_SIZE(n, e->imus, e->feet);
    int64_t often[MOST_IMUS] = {0}, members = 0;
    const int64_t near = wbc_imus_on_link(e, 0);
    memset(readings, 0, 6 * e->imus * sizeof *readings);
    for (int64_t i = 0; i < count; i++) {
        const double *imu = e->wait + i * size + 4 + 3 * n, *spoke = imu + 6 * e->imus;
        for (int64_t k = 0; k < e->imus; k++)
            if (spoke[k] != 0.0) {
                often[k]++;
                for (int j = 0; j < 6; j++) readings[6 * k + j] += imu[6 * k + j];
            }
    }
    for (int64_t k = 0; k < e->imus; k++) {
        if (HAS(near, k) && 2 * often[k] >= often[0]) members |= (int64_t)1 << k;
        for (int j = 0; often[k] && j < 6; j++) readings[6 * k + j] /= (double)often[k];
    }
    return members;
}

/* Whether joints or base moved while messages were stored. */
static int has_moved(const wbc_estimator *e, const wbc_sample *s, const double *rate) {
    if (sqrt(dot3(rate, rate)) > STILL) return 1;
    for (int64_t i = 2; i < e->tree->joints; i++) {
        const int64_t j = e->tree->iv[i] - 6;
        if (fabs(wbc_joint_motion(e, i, e->wait[4 + j], s->positions[j])) > STILL * e->standing_time) return 1;
    }
    return 0;
}

static int collect_standing(const wbc_estimator *e, const wbc_memory *m, const wbc_sample *s, double *out) {
    const int64_t size = WAIT_SIZE(e->tree->nv - 6, e->imus, e->feet);
    int64_t *waits = m->counts + WAITS, heard[MOST_IMUS];
    double *wait = e->wait, readings[6 * MOST_IMUS], mean[6];
    /* Late messages, and more than fit, are dropped: while the robot stands nothing is lost with them. */
    const double earliest = *waits ? wait[(*waits - 1) * size] + e->standing_time / (double)(e->waiting - 2) : 0.0;
    if (*waits ? s->time <= wait[(*waits - 1) * size] || s->time < earliest : !s->heard[0]) return STANDING;
    store_sample(e, s, wait + *waits * size);
    const int64_t count = ++*waits;
    if (s->time - wait[0] < e->standing_time - 1e-9 && count < e->waiting) return STANDING;
    const int64_t members = mean_readings(e, count, readings);
    if (has_moved(e, s, readings)) {
        *waits = s->heard[0] != 0;
        memmove(wait, wait + (count - 1) * size, size * sizeof *wait);
        return STANDING;
    }
    clear(e, m, wait[0]);
    m->counts[MEMBERS] = members, *m->usual = count > 1 ? (s->time - wait[0]) / (double)(count - 1) : 0.0;
    wbc_place_frames(e, m, wait + 4);
    wbc_mean_of_imus(e, 0, members, readings, mean);
    int found = wbc_align_to_gravity(e, mean, mean + 3);
    for (int64_t i = 0; found == DONE && i < count; i++) {
        const wbc_sample one = stored_sample(e, wait + i * size, heard);
        found = process(e, m, &one, 1, out);
    }
    m->counts[BEGUN] = found == DONE, *waits = 0;
    return found;
}

int wbc_estimator_update(const wbc_estimator *e, const wbc_sample *s, double *out) {
    const wbc_memory m = wbc_memory_of(e);
    e->event[0] = 0;
    return m.counts[BEGUN] ? process(e, &m, s, 0, out) : collect_standing(e, &m, s, out);
}
