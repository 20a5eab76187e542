/* External forces from residuals of the generalised momentum, and the wrenches on the soles that explain them. See
 * wbc/estimation/momentum_observer.py. */
#include "core.h"
#include "linear.h"
#include "problem.h"

#include <string.h>

enum { MOST_ROWS = 6 * MOMENTUM_MOST_FEET };
static const double CREEP = 0.05; /* rad/s or m/s: dry friction is fully developed from here on */

static void add_outside(const wbc_momentum *m, const double *v, const double *torque, double dt, double share) {
    const int64_t nv = m->tree->nv;
    const double *M = m->motion, *h = m->motion + BIAS(nv);
    double *gained = m->scratch;
    for (int64_t i = 0; i < nv; i++) gained[i] = (v[i] - m->velocity[i]) / dt;
    for (int64_t i = 0; i < nv; i++) {
        double outside = dot(nv, M + i * nv, gained) + h[i];
        if (i >= 6) {
            const double rate = 0.5 * (v[i] + m->velocity[i]);
            double slide = rate / CREEP;
            slide = slide > 1.0 ? 1.0 : slide < -1.0 ? -1.0 : slide;
            outside -= torque[i - 6] - m->damping[i - 6] * rate - m->friction[i - 6] * slide;
        }
        m->residual[i] += share * (outside - m->residual[i]);
    }
}

static void explain(const wbc_momentum *m) {
    const int64_t nv = m->tree->nv, rows = 6 * m->feet, size = FRAME_SIZE(nv);
    double H[MOST_ROWS * MOST_ROWS], f[MOST_ROWS], triangle[MOST_ROWS * PADDED(MOST_ROWS + 1)];
    double *weighted = m->scratch;
    for (int64_t i = 0; i < rows; i++) {
        const double *row = m->frames + (i / 6) * size + FRAME_JACOBIAN + (i % 6) * nv;
        for (int64_t k = 0; k < nv; k++) weighted[k] = row[k] * (k < 6 ? m->base_trust : 1.0);
        for (int64_t k = 6; m->untied && k < nv; k++) /* forces in loops and gears do no work */
            weighted[k] = dot(nv - 6, m->untied + (k - 6) * (nv - 6), row + 6);
        for (int64_t j = i; j < rows; j++)
            H[i * rows + j] = dot(nv, weighted, m->frames + (j / 6) * size + FRAME_JACOBIAN + (j % 6) * nv);
        H[i * rows + i] += m->lever;
        f[i] = -dot(nv, weighted, m->residual);
    }
    if (!cholesky_solve(rows, H, rows, f, triangle, m->wrenches)) memset(m->wrenches, 0, rows * sizeof(double));
}

int wbc_momentum_update(const wbc_momentum *m, const double *q, const double *v, const double *torque, double dt) {
    const int64_t nv = m->tree->nv;
    if (dt > 0.0 && m->known[0] != 0.0) add_outside(m, v, torque, dt, 1.0 - exp(-m->bandwidth * dt));
    m->known[0] = 1.0;
    wbc_state(m->tree, q, v, m->state, m->scratch, 0, 0, 0);
    wbc_motion(m->tree, m->state, v, m->motion, m->scratch);
    memcpy(m->velocity, v, nv * sizeof *v);
    wbc_frames(m->tree, m->state, m->feet, m->joint, m->placement, m->frames);
    explain(m);
    return DONE;
}
