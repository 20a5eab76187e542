/* Distances of convex hulls by the algorithm of Gilbert, Johnson and Keerthi (1988).
 *
 * A - B is as far from the origin as A is from B. A simplex of its corners moves towards the origin: with v the
 * nearest point of the simplex, the support point w of A - B along -v is added, and corners of weight 0 are
 * removed. All of A - B lies beyond the plane through w normal to v, hence
 *
 *     v.w / |v|  <=  distance  <=  |v|
 *
 * which both ends the search and proves the answer; where only distances up to a limit matter, it ends as soon as
 * the lower bound is above that. Every search starts cold: the answer depends on where the bodies are, not on where
 * they were. Nearest points of triangles: Ericson, Real-Time
 * Collision Detection (2005), sec. 5.1.5, but with v from the triangle's normal.
 */
#include "convex.h"
#include "linear.h"

#include <math.h>
#include <string.h>

static const double TOUCHING = 1e-7; /* m: closer hulls are measured as overlapping ones, in Python */
static const double CERTAIN = 1e-9;  /* m: between the two bounds; faces parallel to 1e-8 rad leave a few 1e-10 */
static const double EXACT = 1e-15;   /* by the size of v: no improvement beyond this */
enum { MOST_ROUNDS = 50, BLOCK = 8 };

/* Corners of A - B, the corners of A that they come from, and barycentric weights of v. */
typedef struct {
    int count;
    double w[4][3], a[4][3], share[4];
} simplex;

/* The corner that is farthest along d (world axes), from the hull's origin. */
static void farthest(const convex *hull, const double *d, double *corner) {
    const double *x = hull->corner, *y = x + hull->stride, *z = y + hull->stride;
    double local[3], most = -INFINITY, found[3];
    int64_t best = 0, i = 0;
    transposed_times3(hull->R, d, local);
    for (; i + BLOCK <= hull->n; i += BLOCK) {
        double along[BLOCK];
        for (int j = 0; j < BLOCK; j++) along[j] = local[0] * x[i + j] + local[1] * y[i + j] + local[2] * z[i + j];
        for (int j = 0; j < BLOCK; j++)
            if (along[j] > most) most = along[j], best = i + j;
    }
    for (; i < hull->n; i++) {
        const double along = local[0] * x[i] + local[1] * y[i] + local[2] * z[i];
        if (along > most) most = along, best = i;
    }
    found[0] = x[best], found[1] = y[best], found[2] = z[best];
    times3(hull->R, found, corner);
}

static void subtract(const double *a, const double *b, double *out) {
    for (int i = 0; i < 3; i++) out[i] = a[i] - b[i];
}

/* Nearest point of the segment p, q to the origin, and the weight of q. */
static double on_segment(const double *p, const double *q, double *v) {
    double along[3];
    subtract(q, p, along);
    const double length = dot3(along, along);
    double share = length > 0.0 ? -dot3(p, along) / length : 0.0;
    share = share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share;
    for (int i = 0; i < 3; i++) v[i] = p[i] + share * along[i];
    return share;
}

/* Nearest point v of a triangle to the origin, and the corners' weights. */
static void on_triangle(const double *a, const double *b, const double *c, double *v, double *share) {
    double ab[3], ac[3], bc[3], n[3], side[3];
    subtract(b, a, ab), subtract(c, a, ac), subtract(c, b, bc);
    cross3(ab, ac, n);
    const double area = dot3(n, n);
    /* Areas of the triangles that the origin's projection makes with the edges. */
    cross3(ab, n, side);
    const double over_ab = dot3(side, a);
    cross3(n, ac, side);
    const double over_ac = dot3(side, a);
    cross3(bc, n, side);
    const double over_bc = dot3(side, b);
    if (area > 0.0 && over_ab >= 0.0 && over_ac >= 0.0 && over_bc >= 0.0) {
        const double off = dot3(n, a) / area;
        for (int i = 0; i < 3; i++) v[i] = off * n[i];
        const double sum = over_ab + over_ac + over_bc;
        share[0] = over_bc / sum, share[1] = over_ac / sum, share[2] = over_ab / sum;
        return;
    }
    double best = INFINITY;
    const double *ends[3][2] = {{a, b}, {a, c}, {b, c}};
    const int places[3][2] = {{0, 1}, {0, 2}, {1, 2}};
    for (int e = 0; e < 3; e++) {
        double there[3];
        const double t = on_segment(ends[e][0], ends[e][1], there), size = dot3(there, there);
        if (!(size < best)) continue;
        best = size;
        memcpy(v, there, sizeof there);
        share[0] = share[1] = share[2] = 0.0;
        share[places[e][0]] = 1.0 - t, share[places[e][1]] = t;
    }
}

/* Likewise of a tetrahedron; false: the origin is inside. */
static int on_tetrahedron(double w[4][3], double *v, double *share) {
    static const int face[4][4] = {{0, 1, 2, 3}, {0, 1, 3, 2}, {0, 2, 3, 1}, {1, 2, 3, 0}};
    double best = INFINITY;
    for (int f = 0; f < 4; f++) {
        const double *a = w[face[f][0]], *b = w[face[f][1]], *c = w[face[f][2]];
        double ab[3], ac[3], ad[3], n[3], there[3], own[3];
        subtract(b, a, ab), subtract(c, a, ac), subtract(w[face[f][3]], a, ad);
        cross3(ab, ac, n);
        const double origin = -dot3(n, a), inner = dot3(n, ad);
        if (origin * inner > 0.0) continue; /* on the side of the fourth corner */
        on_triangle(a, b, c, there, own);
        const double size = dot3(there, there);
        if (!(size < best)) continue;
        best = size;
        memcpy(v, there, sizeof there);
        share[face[f][3]] = 0.0;
        for (int i = 0; i < 3; i++) share[face[f][i]] = own[i];
    }
    return best < INFINITY;
}

/* Nearest point v of the simplex to the origin; corners of weight 0 are removed. */
static int nearest_of(simplex *of, double *v) {
    switch (of->count) {
    case 1:
        of->share[0] = 1.0;
        memcpy(v, of->w[0], sizeof of->w[0]);
        break;
    case 2:
        of->share[1] = on_segment(of->w[0], of->w[1], v);
        of->share[0] = 1.0 - of->share[1];
        break;
    case 3:
        on_triangle(of->w[0], of->w[1], of->w[2], v, of->share);
        break;
    default:
        if (!on_tetrahedron(of->w, v, of->share)) return 0;
    }
    int kept = 0;
    for (int i = 0; i < of->count; i++) {
        if (of->share[i] <= 0.0) continue;
        of->share[kept] = of->share[i];
        memmove(of->w[kept], of->w[i], sizeof of->w[i]);
        memmove(of->a[kept], of->a[i], sizeof of->a[i]);
        kept++;
    }
    of->count = kept;
    return 1;
}

static int has(const simplex *of, const double *w) {
    for (int i = 0; i < of->count; i++)
        if (memcmp(of->w[i], w, sizeof of->w[i]) == 0) return 1;
    return 0;
}

int convex_distance(const convex *A, const convex *B, const double *there, const double *guess, double limit,
                    double *distance, double *normal, double *point) {
    simplex of;
    double v[3], size = INFINITY, least = -INFINITY;
    memset(&of, 0, sizeof of);
    memcpy(v, guess, sizeof v);
    if (!(dot3(v, v) > 0.0)) v[0] = 1.0;
    for (int round = 0; round < MOST_ROUNDS; round++) {
        const double back[3] = {-v[0], -v[1], -v[2]};
        double *w = of.w[of.count], *a = of.a[of.count], b[3], next[3];
        farthest(A, back, a);
        farthest(B, v, b);
        for (int i = 0; i < 3; i++) w[i] = a[i] - (b[i] + there[i]);
        const double length = sqrt(dot3(v, v)), below = dot3(v, w) / length;
        if (below > least) least = below;
        if (least > limit) {
            *distance = least;
            return 1;
        }
        if (has(&of, w) || (of.count && size - least <= EXACT * size)) break;
        const simplex before = of;
        of.count++;
        if (!nearest_of(&of, next)) { /* inside; or of rounding, in four corners of parallel faces: the bounds tell */
            of = before;
            break;
        }
        const double now = sqrt(dot3(next, next));
        if (!(now < size)) { /* rounding: the last one was as good */
            of = before;
            break;
        }
        memcpy(v, next, sizeof v);
        size = now;
        if (!(size > TOUCHING)) return 0;
    }
    if (!(size - least <= CERTAIN)) return 0;
    *distance = size;
    for (int i = 0; i < 3; i++) normal[i] = v[i] / size, point[i] = 0.0;
    for (int k = 0; k < of.count; k++)
        for (int i = 0; i < 3; i++) point[i] += of.share[k] * of.a[k][i];
    return 1;
}
