/* The next footstep: see wbc/gait/adaptation.py. */
#include "core.h"

#include <string.h>

enum { UNKNOWNS = 7, EQUALITIES = 2, ROWS = 8 }; /* u (2), sigma / sigma_0, b (2), w (2) */

static double clipped(double value, double least, double most) { return fmin(fmax(value, least), most); }

/* (u, -u) <= slopes T + offsets: where the foot can come to rest, linearised at T = about. */
static void linearise_reach(const wbc_footstep *s, double *slopes, double *offsets) {
    const double k = wbc_rest_range * s->acceleration;
    for (int i = 0; i < 4; i++) { /* most x, most y, least x, least y */
        const double sign = i < 2 ? 1.0 : -1.0;
        slopes[i] = 2.0 * k * s->about + 0.5 * (sign * s->rate[i % 2]);
        offsets[i] = sign * s->foot[i % 2] - k * (s->about * s->about);
    }
}

static void write_qp(wbc_footstep *s) {
    const double sigma = exp(s->omega * s->left), growth = exp(s->omega * s->double_support);
    const double vrp = s->weights[3] / ((sigma - 1.0) * (sigma - 1.0));
    const double cost[UNKNOWNS] = {
        s->weights[0], s->weights[0], s->weights[1], s->weights[2], s->weights[2], vrp, vrp};
    const double w[2] = {(sigma - 1.0) * s->vrp[0], (sigma - 1.0) * s->vrp[1]};
    const double target[UNKNOWNS] = {s->place[0], s->place[1], 1.0, s->offset[0], s->offset[1], w[0], w[1]};
    /* T = about + (sigma / sigma(about) - 1) / omega, to first order */
    const double per_growth = -exp(s->omega * (s->left - s->about)) / s->omega, shift = s->about - 1.0 / s->omega;
    double slopes[4], offsets[4];
    linearise_reach(s, slopes, offsets);
    for (int i = 0; i < UNKNOWNS; i++) {
        s->P[i * (UNKNOWNS + 1)] = cost[i], s->g[i] = -cost[i] * target[i];
        s->low[i] = -INFINITY, s->high[i] = INFINITY; /* b and w are not bounded */
    }
    s->low[2] = exp(s->omega * s->min_time) / sigma, s->high[2] = exp(s->omega * s->max_time) / sigma;
    for (int axis = 0; axis < 2; axis++) {
        double *dcm = s->A + axis * UNKNOWNS;
        dcm[axis] = s->gain, dcm[2] = -growth * sigma * s->dcm[axis], dcm[3 + axis] = 1.0, dcm[5 + axis] = growth;
        s->low[axis] = s->lower[axis], s->high[axis] = s->upper[axis];
    }
    for (int i = 0; i < 4; i++) {
        const int axis = i % 2;
        const double sign = i < 2 ? 1.0 : -1.0;
        double *sole = s->C + i * UNKNOWNS, *reach = sole + 4 * UNKNOWNS;
        sole[2] = -sigma * s->sole[axis], sole[5 + axis] = sign, s->u[i] = -s->sole[axis];
        reach[axis] = sign, reach[2] = per_growth * slopes[i], s->u[4 + i] = offsets[i] + slopes[i] * shift;
    }
    for (int i = 0; i < ROWS; i++) s->l[i] = -INFINITY; /* upper bounds only */
}

int wbc_solve_footstep(wbc_footstep *s, double eps, int64_t most) {
    s->min_time = fmax(s->min_time, wbc_rest_time(s->acceleration, s->foot, s->rate, s->lower, s->upper));
    s->max_time = fmax(s->max_time, s->min_time), s->about = clipped(s->about, s->min_time, s->max_time);
    write_qp(s);
    wbc_qp qp = {.n = UNKNOWNS, .k = EQUALITIES, .m = ROWS, .wide = UNKNOWNS, .eps = eps};
    qp.P = s->P, qp.A = s->A, qp.C = s->C, qp.g = s->g, qp.lower = s->low, qp.upper = s->high, qp.b = s->b;
    qp.l = s->l, qp.u = s->u, qp.x = s->x, qp.y = s->y, qp.z = s->multipliers, qp.z_box = qp.z + ROWS;
    qp.found = s->found;
    int64_t sizes[3];
    wbc_sizes(UNKNOWNS, EQUALITIES, ROWS, sizes);
    double scratch[sizes[0]];
    int64_t order[sizes[1]];
    const int status = wbc_solve_qp(&qp, 0, most, scratch, order);
    return status == DONE ? wbc_place_footstep(s, 1) : status;
}

int wbc_place_footstep(wbc_footstep *s, int solved) {
    if (!solved) {
        for (int i = 0; i < 2; i++) s->place[i] = clipped(s->place[i], s->lower[i], s->upper[i]);
        s->left = clipped(s->left, s->min_time, s->max_time);
        return DONE;
    }
    const double sigma = fmax(s->x[2] * exp(s->omega * s->left), 1e-9);
    s->left = clipped(log(sigma) / s->omega, s->min_time, s->max_time);
    const double scale = expm1(s->omega * s->left);
    for (int i = 0; i < 2; i++) s->place[i] = s->x[i], s->offset[i] = s->x[3 + i], s->vrp[i] = s->x[5 + i] / scale;
    return DONE;
}
