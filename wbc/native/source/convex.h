/* How far two convex bodies are apart. */
#ifndef WBC_CONVEX_H
#define WBC_CONVEX_H

#include <stdint.h>

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* The hull of n corners, x y z of all (each n, one array behind another by stride), in axes R. */
typedef struct {
    const double *corner;
    int64_t n, stride;
    const double *R; /* (3, 3) to the world's axes */
} convex;

/* Distance between A, and B whose origin is at `there` from A's; unit normal from B to A; nearest
 * point of A from its origin, world axes; guess is about where A is from B. False: they touch, or
 * the answer is not within a tenth of a nanometre of a bound from below. */
int convex_distance(const convex *A, const convex *B, const double *there, const double *guess,
                    double *distance, double *normal, double *point);

#pragma GCC visibility pop

#endif
