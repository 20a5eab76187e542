/* Rotations by rotation vectors: exponential, its integrals, logarithm. */
#ifndef WBC_ROTATION_H
#define WBC_ROTATION_H

#include "linear.h"

#include <math.h>
#include <string.h>

/* out = a + b [r] + c [r]^2 */
static inline void polynomial(const double *r, double a, double b, double c, double *out) {
    const double tt = dot3(r, r);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) out[3 * i + j] = c * r[i] * r[j] + (i == j ? a - c * tt : 0.0);
    out[1] -= b * r[2], out[2] += b * r[1], out[3] += b * r[2];
    out[5] -= b * r[0], out[6] -= b * r[1], out[7] += b * r[0];
}

/* R <- R (3 - R'R) / 2: a Newton step to the nearest rotation, against the sum of roundings. */
static inline void orthonormal(double *R) {
    double G[9], out[9];
    transposed_product3(R, R, G);
    for (int i = 0; i < 9; i++) G[i] = (i % 4 ? 0.0 : 1.5) - 0.5 * G[i];
    product3(R, G, out);
    memcpy(R, out, sizeof out);
}

/* rad: closer to half a turn the axis is taken from the symmetric part. */
static const double NEAR_HALF_TURN = 0.01;
/* rad: smaller angles use series, which lose no digits. */
static const double SMALL_ANGLE = 0.1;

/* Rotation vector (3) of R; near half a turn the axis is taken from R + R', where the sines vanish. */
static inline void logarithm(const double *R, double *r) {
    const double w[3] = {0.5 * (R[7] - R[5]), 0.5 * (R[2] - R[6]), 0.5 * (R[3] - R[1])};
    const double sine = sqrt(dot3(w, w)), cosine = 0.5 * (R[0] + R[4] + R[8] - 1.0);
    double factor;
    if (sine < SMALL_ANGLE && cosine > 0.0) { /* asin(s) / s */
        const double s = sine * sine;
        factor = 1.0 + s * (1.0 / 6 +
                            s * (3.0 / 40 + s * (15.0 / 336 +
                                                 s * (105.0 / 3456 + s * (945.0 / 42240 + s * (10395.0 / 599040))))));
    } else {
        const double angle = atan2(sine, cosine);
        if (!(angle < PI - NEAR_HALF_TURN)) { /* the largest diagonal entry has the largest part of the axis */
            const int i = R[0] >= R[4] ? (R[0] >= R[8] ? 0 : 2) : R[4] >= R[8] ? 1 : 2;
            const int j = (i + 1) % 3, k = (i + 2) % 3;
            double part[3];
            part[i] = 1.0 + R[4 * i] - R[4 * j] - R[4 * k];
            part[j] = R[3 * i + j] + R[3 * j + i], part[k] = R[3 * i + k] + R[3 * k + i];
            const double sign = w[i] < 0.0 ? -1.0 : 1.0, length = sqrt(dot3(part, part));
            for (int m = 0; m < 3; m++) r[m] = sign * angle * part[m] / length;
            return;
        }
        factor = angle / sine;
    }
    for (int i = 0; i < 3; i++) r[i] = factor * w[i];
}

#endif
