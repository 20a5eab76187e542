/* Feet as an estimator sees them: in the air, bearing, standing still, slipping. */
#include "estimator.h"
#include "linear.h"

#include <string.h>

static const double RECENT = 0.9; /* share of a foot's pace that is left after a message */
static const double CALMER = 3.0; /* times longer must be still, and that much stiller, what slipped */
static const double IN_TIME = 1e-9; /* s, of rounding */
enum { STRIKES = 2 };             /* places beyond the gate in a row that make a slip; one is an outlier */
/* Normalised innovations squared that one of 10,000 sound ones exceeds, of 6 and of 3 rows. */
static const double GATE_6 = 27.86, GATE_3 = 21.11;

/* Where a foot is seen. */
typedef struct {
    double place[PLACE_SIZE], noise[36], speed;
} foot_seen;

static void watch_anew(const wbc_memory *m, int64_t k, int bears, double since, int slips) {
    m->bears[k] = bears, m->since[k] = since, m->slips[k] = slips;
    m->strikes[k] = 0, m->moves[k] = INFINITY;
}

static void slips(const wbc_estimator *e, const wbc_memory *m, int64_t k) {
    wbc_filter_release(e->filter, k);
    watch_anew(m, k, 1, *m->time, 1);
}

void wbc_let_go(const wbc_estimator *e, const wbc_memory *m) {
    for (int64_t k = 0; k < e->feet; k++) {
        if (e->filter->held[k]) wbc_filter_release(e->filter, k);
        watch_anew(m, k, (int)m->bears[k], *m->time, 0);
    }
}

/* Correct by a foot's place: DONE, OUTLIER with the innovation's length, or NOT_FINITE. */
static int correct(const wbc_estimator *e, const wbc_memory *m, int64_t k, const foot_seen *seen, double *squared) {
    double innovation[7];
    const int64_t rows = e->flat[k] ? 6 : 3;
    int said = wbc_filter_correct(e->filter, k, seen->place, seen->noise, rows, rows == 6 ? GATE_6 : GATE_3,
                                  innovation);
    const double *off = innovation + 1, *turn = innovation + 4;
    if (said == DONE) {
        m->strikes[k] = 0;
        *squared += innovation[0], m->counts[NIS_ROWS] += rows;
    }
    if (said != OUTLIER) return said;
    if (rows == 6) { /* a foot that rolls over an edge may still stand on it, for once */
        said = wbc_filter_correct(e->filter, k, seen->place, seen->noise, 3, GATE_3, innovation);
        if (said == NOT_FINITE) return said;
        if (said == DONE) {
            const double by = 1e3 * sqrt(dot3(turn, turn));
            *squared += innovation[0], m->counts[NIS_ROWS] += 3;
            wbc_note(e, m->strikes[k] + 1 < STRIKES ? ROLLS : ROLLS_OVER, k, by);
            if (++m->strikes[k] >= STRIKES) slips(e, m, k);
            return DONE;
        }
    }
    wbc_note(e, m->strikes[k] + 1 < STRIKES ? OUTSIDE : SLIPPED_OFF, k, 1e3 * sqrt(dot3(off, off)));
    if (++m->strikes[k] >= STRIKES) slips(e, m, k);
    return DONE;
}

/* Hold, correct by, or release one foot. */
static int track(const wbc_estimator *e, const wbc_memory *m, int64_t k, const foot_seen *seen, double *squared) {
    const double time = *m->time;
    if (!m->stands[k]) {
        const double calm = m->slips[k] ? CALMER : 1.0; /* slipping on, it would drag the estimate */
        if (time - m->since[k] >= calm * e->settle - IN_TIME && seen->speed < e->still / calm) {
            wbc_filter_hold(e->filter, k, seen->place, seen->noise);
            watch_anew(m, k, 1, m->since[k], 0);
        }
        return DONE;
    }
    if (!m->bears[k]) return wbc_filter_release(e->filter, k);
    if (seen->speed <= e->slides) m->moves[k] = INFINITY;
    else if (m->moves[k] == INFINITY) m->moves[k] = time;
    else if (time - m->moves[k] >= e->sliding - IN_TIME) {
        wbc_note(e, SLIPS, k, seen->speed);
        slips(e, m, k);
        return DONE;
    }
    return correct(e, m, k, seen, squared);
}

/* Return which of two feet that stand slipped, -1 if none did, by how far they are apart: joints know that,
 * whatever the base does. A slip that is too slow to be seen as a speed is seen here. */
static int64_t apart(const wbc_estimator *e, const wbc_memory *m, const foot_seen *seen, double *by) {
    const int64_t feet = e->feet, *held = e->filter->held;
    for (int64_t k = 0; k < feet; k++) m->pace[k] = RECENT * m->pace[k] + (1.0 - RECENT) * seen[k].speed;
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

/* Say which feet bear, by what there is of sensors. */
static void load(const wbc_estimator *e, const wbc_memory *m, const wbc_sample *s, int standing) {
    const int felt = !standing && !s->loads && m->counts[FEELS];
    const double *shares = felt ? e->estimated_load : e->load;
    if (!standing && !s->loads && !felt) wbc_note(e, NO_LOADS, 0, 0.0);
    for (int64_t k = 0; k < e->feet; k++) {
        const double share = standing   ? 1.0
                             : s->loads ? s->loads[k]
                             : felt     ? e->momentum->wrenches[6 * k + 2] / e->weight
                                        : 1.0;
        const int bears = share > (m->bears[k] ? shares[0] : shares[1]);
        if (bears != (int)m->bears[k]) watch_anew(m, k, bears, *m->time, 0);
    }
}

static void see(const wbc_estimator *e, int64_t k, const double *rate, const double *rates, foot_seen *seen) {
    const int64_t nv = e->tree->nv, size = FRAME_SIZE(nv);
    const double *soles = e->frames + e->imus * size, *imu = soles + e->feet * size;
    wbc_foot_place(nv, imu, soles + k * size, rates, e->encoder_variance, e->floor, seen->place, seen->noise);
    seen->speed = wbc_filter_foot_speed(e->filter, rate, seen->place);
}

/* The foot to count on where none stands: of those that bear the slowest, -1 if none does. Forces that are
 * estimated make a foot in the air bear, too, as soon as the estimate is off. */
static int64_t slowest(const wbc_estimator *e, const wbc_memory *m, const double *rate, const double *rates) {
    int64_t found = -1;
    foot_seen seen;
    double least = INFINITY;
    for (int64_t k = 0; k < e->feet; k++) {
        if (!m->bears[k] || m->stands[k]) continue;
        see(e, k, rate, rates, &seen);
        if (seen.speed < least) least = seen.speed, found = k;
    }
    return found;
}

int wbc_see_feet(const wbc_estimator *e, const wbc_memory *m, const wbc_sample *s, const double *rate,
                 const double *rates, int standing, double *squared) {
    const int64_t *held = e->filter->held;
    foot_seen seen[MOMENTUM_MOST_FEET];
    double by = 0.0;
    int64_t stands = 0, bears = 0;
    load(e, m, s, standing);
    m->counts[NIS_ROWS] = 0, *squared = 0.0;
    for (int64_t k = 0; k < e->feet; k++) m->stands[k] = held[k], seen[k].speed = 0.0;
    const int lost = *m->time - *m->lost_since > e->lost;
    const int64_t counted = lost ? slowest(e, m, rate, rates) : -1;
    for (int64_t k = 0; k < e->feet; k++) {
        if (!m->bears[k] && !m->stands[k]) continue;
        see(e, k, rate, rates, seen + k);
        const double speed = seen[k].speed;
        if (k == counted) {
            wbc_note(e, COUNTED_ANYWAY, k, speed);
            wbc_filter_widen(e->filter, speed * speed);
            seen[k].speed = 0.0, m->since[k] = -INFINITY;
        }
        const int said = track(e, m, k, seen + k, squared);
        if (said != DONE) return said;
        seen[k].speed = speed;
    }
    for (int64_t k = 0; k < e->feet; k++) stands += held[k];
    const int64_t slipped = apart(e, m, seen, &by);
    if (slipped >= 0) {
        wbc_note(e, FEET_APART, slipped, 1e3 * by);
        slips(e, m, slipped);
    }
    for (int64_t k = 0; k < e->feet; k++) m->stands[k] = held[k], bears += m->bears[k];
    if (stands > (slipped >= 0) || !bears) *m->lost_since = INFINITY;
    else if (*m->lost_since == INFINITY) *m->lost_since = *m->time;
    return DONE;
}
