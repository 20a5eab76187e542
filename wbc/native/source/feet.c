/* Contact states of the feet in an estimator: in the air, loaded, standing, slipping. */
#include "estimator.h"
#include "linear.h"

#include <string.h>

static const double SMOOTHING = 0.9;  /* of the mean speed of a foot, per message */
static const double AFTER_SLIP = 3.0; /* a foot that slipped must be still for so many times longer, and be so many
                                       * times slower */
static const double IN_TIME = 1e-9;   /* s: rounding */
enum { STRIKES = 2 };                 /* outliers in a row that make a slip; one alone is an outlier */
/* Quantiles of the chi-squared distribution, exceeded by one innovation in 10,000, of 6 and of 3 rows. */
static const double GATE_6 = 27.86, GATE_3 = 21.11;

/* A foot seen from the IMU. */
typedef struct {
    double place[PLACE_SIZE], noise[36], speed;
} foot_seen;

static void reset_contact(const wbc_memory *m, int64_t k, int bears, double since, int slips) {
    m->bears[k] = bears, m->since[k] = since, m->slips[k] = slips;
    m->strikes[k] = 0, m->moves[k] = INFINITY;
}

static void mark_slipped(const wbc_estimator *e, const wbc_memory *m, int64_t k) {
    wbc_filter_release(e->filter, k);
    reset_contact(m, k, 1, *m->time, 1);
}

void wbc_release_feet(const wbc_estimator *e, const wbc_memory *m) {
    for (int64_t k = 0; k < e->feet; k++) {
        if (e->filter->held[k]) wbc_filter_release(e->filter, k);
        reset_contact(m, k, (int)m->bears[k], *m->time, 0);
    }
}

/* Correct by a foot's pose: DONE, OUTLIER with the innovation's length, or NOT_FINITE. */
static int correct(const wbc_estimator *e, const wbc_memory *m, int64_t k, const foot_seen *seen, double *squared) {
    double innovation[7];
    const int64_t rows = e->flat[k] ? 6 : 3;
    int status =
        wbc_filter_correct(e->filter, k, seen->place, seen->noise, rows, rows == 6 ? GATE_6 : GATE_3, innovation);
    const double *off = innovation + 1, *turn = innovation + 4;
    if (status == DONE) {
        m->strikes[k] = 0;
        *squared += innovation[0], m->counts[NIS_ROWS] += rows;
    }
    if (status != OUTLIER) return status;
    if (rows == 6) /* a foot that rolls over an edge may stand on that edge, once */
        status = wbc_filter_correct(e->filter, k, seen->place, seen->noise, 3, GATE_3, innovation);
    if (status == NOT_FINITE) return status;
    const int slipped = ++m->strikes[k] >= STRIKES;
    if (status == DONE) {
        *squared += innovation[0], m->counts[NIS_ROWS] += 3;
        wbc_report(e, slipped ? ROLLS_OVER : ROLLS, k, 1e3 * sqrt(dot3(turn, turn)));
    } else wbc_report(e, slipped ? SLIPPED_OFF : OUTSIDE, k, 1e3 * sqrt(dot3(off, off)));
    if (slipped) mark_slipped(e, m, k);
    return DONE;
}

/* Hold, correct by, or release one foot. */
static int track(const wbc_estimator *e, const wbc_memory *m, int64_t k, const foot_seen *seen, double *squared) {
    const double time = *m->time;
    if (!m->stands[k]) {
        const double calm = m->slips[k] ? AFTER_SLIP : 1.0; /* while it slips it would drag the estimate */
        if (time - m->since[k] >= calm * e->settle - IN_TIME && seen->speed < e->still / calm) {
            wbc_filter_hold(e->filter, k, seen->place, seen->noise);
            reset_contact(m, k, 1, m->since[k], 0);
        }
        return DONE;
    }
    if (!m->bears[k]) return wbc_filter_release(e->filter, k);
    if (seen->speed <= e->slides) m->moves[k] = INFINITY;
    else if (m->moves[k] == INFINITY) m->moves[k] = time;
    else if (time - m->moves[k] >= e->sliding - IN_TIME) {
        wbc_report(e, SLIPS, k, seen->speed);
        mark_slipped(e, m, k);
        return DONE;
    }
    return correct(e, m, k, seen, squared);
}

/* Return which of two standing feet slipped, -1 for none, by their distance, which the joints know whatever the
 * base does. This finds slips too slow to be seen as a speed. */
static int64_t find_slipped(const wbc_estimator *e, const wbc_memory *m, const foot_seen *seen, double *by) {
    const int64_t feet = e->feet, *held = e->filter->held;
    for (int64_t k = 0; k < feet; k++) m->pace[k] = SMOOTHING * m->pace[k] + (1.0 - SMOOTHING) * seen[k].speed;
    for (int64_t i = 0; i < feet; i++)
        for (int64_t j = i + 1; j < feet; j++) {
            double *first = m->apart + feet * i + j, between[3];
            if (!held[i] || !held[j]) {
                *first = NAN;
                continue;
            }
            for (int c = 0; c < 3; c++) between[c] = seen[i].place[c] - seen[j].place[c];
            const double now = sqrt(dot3(between, between));
            if (isnan(*first)) *first = now;
            *by = fabs(now - *first);
            if (*by <= e->apart) continue;
            for (int64_t k = 0; k < feet * feet; k++) m->apart[k] = NAN;
            return m->pace[i] > m->pace[j] ? i : j;
        }
    return -1;
}

/* Decide which feet are loaded, by the sensors there are. */
static void update_loads(const wbc_estimator *e, const wbc_memory *m, const wbc_sample *s, int standing) {
    const int felt = !standing && !s->loads && m->counts[FEELS];
    const double *shares = felt ? e->estimated_load : e->load;
    if (!standing && !s->loads && !felt) wbc_report(e, NO_LOADS, 0, 0.0);
    for (int64_t k = 0; k < e->feet; k++) {
        const double share = standing   ? 1.0
                             : s->loads ? s->loads[k]
                             : felt     ? e->momentum->wrenches[6 * k + 2] / e->weight
                                        : 1.0;
        const int bears = share > (m->bears[k] ? shares[0] : shares[1]);
        if (bears != (int)m->bears[k]) reset_contact(m, k, bears, *m->time, 0);
    }
}

static void observe(const wbc_estimator *e, int64_t k, const double *rate, const double *rates, foot_seen *seen) {
    const int64_t nv = e->tree->nv, size = FRAME_SIZE(nv);
    const double *soles = e->frames + e->imus * size, *imu = soles + e->feet * size;
    wbc_foot_place(nv, imu, soles + k * size, rates, e->encoder_variance, e->floor, seen->place, seen->noise);
    seen->speed = wbc_filter_foot_speed(e->filter, rate, seen->place);
}

/* The foot to use if none stands: the slowest of those that are loaded, -1 for none. Estimated loads of feet in the
 * air are wrong as soon as the estimate is. */
static int64_t slowest_loaded(const wbc_estimator *e, const wbc_memory *m, const double *rate, const double *rates) {
    int64_t found = -1;
    foot_seen seen;
    double least = INFINITY;
    for (int64_t k = 0; k < e->feet; k++) {
        if (!m->bears[k] || m->stands[k]) continue;
        observe(e, k, rate, rates, &seen);
        if (seen.speed < least) least = seen.speed, found = k;
    }
    return found;
}

int wbc_update_feet(const wbc_estimator *e, const wbc_memory *m, const wbc_sample *s, const double *rate,
                    const double *rates, int standing, double *squared) {
    const int64_t *held = e->filter->held;
    foot_seen seen[MOMENTUM_MOST_FEET];
    double by = 0.0;
    int64_t stands = 0, bears = 0;
    update_loads(e, m, s, standing);
    m->counts[NIS_ROWS] = 0, *squared = 0.0;
    for (int64_t k = 0; k < e->feet; k++) m->stands[k] = held[k], seen[k].speed = 0.0;
    const int lost = *m->time - *m->lost_since > e->lost;
    const int64_t counted = lost ? slowest_loaded(e, m, rate, rates) : -1;
    for (int64_t k = 0; k < e->feet; k++) {
        if (!m->bears[k] && !m->stands[k]) continue;
        observe(e, k, rate, rates, seen + k);
        const double speed = seen[k].speed;
        if (k == counted) {
            wbc_report(e, COUNTED_ANYWAY, k, speed);
            wbc_filter_widen(e->filter, speed * speed);
            seen[k].speed = 0.0, m->since[k] = -INFINITY;
        }
        const int status = track(e, m, k, seen + k, squared);
        if (status != DONE) return status;
        seen[k].speed = speed;
    }
    for (int64_t k = 0; k < e->feet; k++) stands += held[k];
    const int64_t slipped = find_slipped(e, m, seen, &by);
    if (slipped >= 0) {
        wbc_report(e, FEET_APART, slipped, 1e3 * by);
        mark_slipped(e, m, slipped);
    }
    for (int64_t k = 0; k < e->feet; k++) m->stands[k] = held[k], bears += m->bears[k];
    if (stands > (slipped >= 0) || !bears) *m->lost_since = INFINITY;
    else if (*m->lost_since == INFINITY) *m->lost_since = *m->time;
    return DONE;
}
