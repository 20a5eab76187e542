#include "sensing.h"

#include <string.h>

void wbc_sensing_start(wbc_sensing *s) {
    memset(s, 0, sizeof *s);
    s->last = -INFINITY;
    s->filter = wbc_planned_filter, s->momentum = wbc_planned_momentum, s->estimator = wbc_planned_estimator;
    wbc_filter *f = &s->filter;
    f->held = s->held, f->x = s->filter_x, f->P = s->P, f->scratch = s->filter_scratch, f->origin = s->origin;
    wbc_momentum *m = &s->momentum;
    m->known = s->known, m->residual = s->residual, m->velocity = s->velocity, m->motion = s->motion;
    m->state = s->momentum_state, m->frames = s->momentum_frames, m->wrenches = s->wrenches;
    m->scratch = s->momentum_scratch;
    wbc_estimator *e = &s->estimator;
    e->filter = f, e->momentum = m, e->x = s->x, e->counts = s->counts, e->frames = s->frames;
    e->state = s->state, e->scratch = s->scratch, e->wait = s->wait, e->detail = s->detail, e->event = s->event;
    wbc_estimator_reset(e);
}

int wbc_sensing_take(wbc_sensing *s, const wbc_sample *sample, double out[WBC_ESTIMATE]) {
    if (!(sample->time > s->last)) return LATE_MESSAGE;
    s->last = sample->time;
    return wbc_estimator_update(&s->estimator, sample, out);
}
