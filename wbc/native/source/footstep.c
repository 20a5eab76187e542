/* The QP of the next footstep: see wbc/gait/adaptation.py. */
#include "core.h"

#include <string.h>

enum { UNKNOWNS = 7, EQUALITIES = 2, ROWS = 8 }; /* u (2), sigma / sigma_0, b (2), w (2) */

int wbc_footstep(const double *given, double *numbers) {
    wbc_footstep_plan s;
    memcpy(&s, given, sizeof s);
    const double sigma = exp(s.omega * s.left), growth = exp(s.omega * s.double_support);
    const double vrp = s.weights[3] / ((sigma - 1.0) * (sigma - 1.0));
    const double cost[UNKNOWNS] = {s.weights[0], s.weights[0], s.weights[1], s.weights[2], s.weights[2], vrp, vrp};
    const double target[UNKNOWNS] = {
        s.place[0], s.place[1], 1.0, s.offset[0], s.offset[1], (sigma - 1.0) * s.vrp[0], (sigma - 1.0) * s.vrp[1]};
    /* T = about + (sigma / sigma(about) - 1) / omega, to first order */
    const double per_growth = -exp(s.omega * (s.left - s.about)) / s.omega, shift = s.about - 1.0 / s.omega;
    double *P = numbers, *A = P + UNKNOWNS * UNKNOWNS, *C = A + EQUALITIES * UNKNOWNS, *g = C + ROWS * UNKNOWNS;
    double *lower = g + UNKNOWNS, *upper = lower + UNKNOWNS, *b = upper + UNKNOWNS, *l = b + EQUALITIES,
           *u = l + ROWS;
    memset(numbers, 0, (g - numbers) * sizeof *numbers);
    for (int i = 0; i < UNKNOWNS; i++) {
        P[i * (UNKNOWNS + 1)] = cost[i], g[i] = -cost[i] * target[i];
        lower[i] = -INFINITY, upper[i] = INFINITY; /* b and w are not bounded */
    }
    lower[2] = exp(s.omega * s.min_time) / sigma, upper[2] = exp(s.omega * s.max_time) / sigma;
    for (int axis = 0; axis < 2; axis++) {
        double *dcm = A + axis * UNKNOWNS;
        dcm[axis] = s.gain, dcm[2] = -growth * sigma * s.dcm[axis], dcm[3 + axis] = 1.0, dcm[5 + axis] = growth;
        b[axis] = 0.0, lower[axis] = s.lower[axis], upper[axis] = s.upper[axis];
    }
    for (int i = 0; i < 4; i++) { /* most x, most y, least x, least y */
        const int axis = i % 2;
        const double sign = i < 2 ? 1.0 : -1.0;
        double *sole = C + i * UNKNOWNS, *reach = sole + 4 * UNKNOWNS;
        sole[2] = -sigma * s.sole[axis], sole[5 + axis] = sign, u[i] = -s.sole[axis];
        reach[axis] = sign, reach[2] = per_growth * s.slopes[i], u[4 + i] = s.offsets[i] + s.slopes[i] * shift;
    }
    for (int i = 0; i < ROWS; i++) l[i] = -INFINITY; /* upper bounds only */
    return 0;
}
