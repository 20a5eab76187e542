/* Distance of two convex hulls. */
#ifndef WBC_CONVEX_H
#define WBC_CONVEX_H

#include <stdint.h>

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* The hull of n corners: x, y, z arrays (n) stride apart, in axes R. */
typedef struct {
    const double *corner;
    int64_t n, stride;
    const double *R; /* (3, 3) to the world's axes */
} convex;

/* Distance of A and B, whose origin is at `there` from A's; unit normal from B to A; nearest point of A from its
 * origin, world axes. guess: about the direction from B to A. A distance above the limit is a lower bound, without
 * normal and point. False: they overlap, or the answer is not proved to a nanometre. */
int convex_distance(const convex *A, const convex *B, const double *there, const double *guess, double limit,
                    double *distance, double *normal, double *point);

#pragma GCC visibility pop

#endif
