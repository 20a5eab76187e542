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

/* Rotation vector of a rotation by less than about a right angle, as innovations are. */
static inline void logarithm(const double *R, double *r) {
    const double s[3] = {0.5 * (R[7] - R[5]), 0.5 * (R[2] - R[6]), 0.5 * (R[3] - R[1])};
    const double sine = sqrt(dot3(s, s)), cosine = 0.5 * (R[0] + R[4] + R[8] - 1.0);
    const double scale = sine < 1e-8 ? 1.0 : atan2(sine, cosine) / sine;
    for (int i = 0; i < 3; i++) r[i] = scale * s[i];
}

#endif
