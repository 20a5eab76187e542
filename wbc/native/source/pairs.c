/* The nearest pairs of capsules and spheres on a robot, and how their distances change: what
 * wbc/robot/collision says, but for other shapes. Of these, which a capsule covers, the pairs that
 * may be among the nearest are returned too, to be measured by who can.
 */
#include "core.h"
#include "linear.h"

#include <string.h>

/* As in wbc/robot/collision/distances.py. */
static const double PARALLEL = 1e-10, TOUCHING = 1e-9;

/* Of a body, in a row: start, unit direction and middle, world axes. */
enum { START = 0, DIRECTION = 3, MIDDLE = 6, PLACED = 9 };
enum { LENGTH = 0, RADIUS = 1, REACH = 2, SIZES = 3 };
enum { FOUND = 7 }; /* distance, normal, point on the first */

static void place_bodies(const wbc_pairs *of, const double *state, double *placed) {
    const int64_t nv = of->nv;
    const double *rotations = state + ROTATIONS(nv), *origins = state + ORIGINS(nv, of->joints);
    for (int64_t b = 0; b < of->bodies; b++) {
        const double *R = rotations + 9 * of->joint[b], *p = origins + 3 * of->joint[b];
        for (int part = 0; part < 3; part++) {
            double local[3], *to = placed + PLACED * b + 3 * part;
            for (int i = 0; i < 3; i++) local[i] = of->local[9 * b + 3 * i + part];
            times3(R, local, to);
            for (int i = 0; i < 3 && part != 1; i++) to[i] += p[i];
        }
    }
}

static double within(double x, double length) {
    const double least = x > 0.0 ? x : 0.0;
    return least < length ? least : length;
}

/* Ericson, Real-Time Collision Detection (2005), sec. 5.1.9; false where the axes touch. */
static int measure(const wbc_pairs *of, const double *placed, int64_t pair, double *found) {
    const int64_t first = of->pair[2 * pair], second = of->pair[2 * pair + 1];
    const double *A = placed + PLACED * first, *B = placed + PLACED * second;
    const double *a = A + DIRECTION, *b = B + DIRECTION;
    const double *own = of->size + SIZES * first, *other = of->size + SIZES * second;
    double between[3], apart[3];
    for (int i = 0; i < 3; i++) between[i] = A[i] - B[i];
    const double ab = dot3(a, b), ar = dot3(a, between), br = dot3(b, between);
    const double sine = 1.0 - ab * ab > PARALLEL ? 1.0 - ab * ab : PARALLEL;
    const double near = within((ab * br - ar) / sine, own[LENGTH]);
    const double t = within(ab * near + br, other[LENGTH]);
    const double s = within(ab * t - ar, own[LENGTH]);
    for (int i = 0; i < 3; i++) apart[i] = between[i] + s * a[i] - t * b[i];
    const double distance = sqrt(dot3(apart, apart));
    if (!(distance >= TOUCHING)) return 0;
    found[0] = distance - own[RADIUS] - other[RADIUS];
    for (int i = 0; i < 3; i++) {
        found[1 + i] = apart[i] / distance;
        found[4 + i] = A[i] + s * a[i] - own[RADIUS] * found[1 + i];
    }
    return 1;
}

/* The k-th smallest (from 0) of n values, which are put in another order: Hoare's selection. */
static double smallest(double *values, int64_t n, int64_t k) {
    int64_t low = 0, high = n - 1;
    while (low < high) {
        const double pivot = values[(low + high) / 2];
        int64_t i = low, j = high;
        while (i <= j) {
            while (values[i] < pivot) i++;
            while (pivot < values[j]) j--;
            if (i <= j) {
                const double swap = values[i];
                values[i++] = values[j], values[j--] = swap;
            }
        }
        if (k <= j)
            high = j;
        else if (k >= i)
            low = i;
        else
            break;
    }
    return values[k];
}

/* Measure the capsules whose balls are no farther than limit and that are not yet; false: see
 * measure. Those not measured are infinitely far. */
static int measure_near(const wbc_pairs *of, const double *placed, const double *lower,
                        double limit, double *found) {
    for (int64_t p = 0; p < of->pairs; p++)
        if (!of->solid[p] && lower[p] <= limit && found[FOUND * p] == INFINITY &&
            !measure(of, placed, p, found + FOUND * p))
            return 0;
    return 1;
}

int wbc_nearest(const wbc_pairs *of, const double *state, int64_t count, double *scratch,
                int64_t *chosen, double *nearest) {
    double *placed = scratch, *lower = placed + PLACED * of->bodies;
    double *sorted = lower + of->pairs, *found = sorted + of->pairs;
    int64_t capsules = 0, measured = 0, k = 0;
    place_bodies(of, state, placed);
    for (int64_t p = 0; p < of->pairs; p++) {
        const int64_t a = of->pair[2 * p], b = of->pair[2 * p + 1];
        double apart[3];
        for (int i = 0; i < 3; i++)
            apart[i] = placed[PLACED * a + MIDDLE + i] - placed[PLACED * b + MIDDLE + i];
        lower[p] = sqrt(dot3(apart, apart)) - of->size[SIZES * a + REACH] - of->size[SIZES * b + REACH];
        if (!(lower[p] < INFINITY)) return -1;
        if (!of->solid[p]) sorted[capsules++] = lower[p];
        found[FOUND * p] = INFINITY;
    }
    if (count < 1 || capsules < count) return -1;
    /* Count pairs that are near by their balls bound how far the nearest can be. */
    if (!measure_near(of, placed, lower, smallest(sorted, capsules, count - 1), found)) return -1;
    for (int round = 0; round < 2; round++) {
        measured = 0;
        for (int64_t p = 0; p < of->pairs; p++)
            if (!of->solid[p] && found[FOUND * p] < INFINITY) sorted[measured++] = found[FOUND * p];
        const double farthest = smallest(sorted, measured, count - 1);
        if (round == 0) {
            if (!measure_near(of, placed, lower, farthest, found)) return -1;
            continue;
        }
        for (int64_t p = 0; p < of->pairs; p++) {
            if (of->solid[p] && lower[p] <= farthest && !measure(of, placed, p, found + FOUND * p))
                found[FOUND * p] = -INFINITY; /* the capsules' axes touch: as near as can be */
            if (found[FOUND * p] <= farthest) chosen[k++] = p;
        }
    }
    for (int64_t i = 0; i < k; i++)
        for (int r = 0; r < FOUND; r++) nearest[r * k + i] = found[FOUND * chosen[i] + r];
    return (int)k;
}

/* Add the line of force [n, p x n] times the twists of what moves a joint. */
static void add_line(const wbc_tree *tree, const double *state, int64_t joint, const double *n,
                     const double *arm, double sign, double *row) {
    const int64_t nv = tree->nv;
    const double *T = state + TWISTS(nv);
    for (int64_t j = joint; j > 0; j = tree->parent[j]) {
        const int64_t first = j == 1 ? 0 : tree->iv[j], last = j == 1 ? 6 : first + 1;
        for (int64_t c = first; c < last; c++) {
            double sum = 0.0;
            for (int i = 0; i < 3; i++) sum += n[i] * T[i * nv + c] + arm[i] * T[(3 + i) * nv + c];
            row[c] += sign * sum;
        }
    }
}

int wbc_pair_rows(const wbc_pairs *of, const wbc_tree *tree, const double *state, int64_t k,
                  const int64_t *chosen, const double *normal, const double *point, double *rows) {
    memset(rows, 0, k * tree->nv * sizeof *rows);
    for (int64_t i = 0; i < k; i++) {
        const int64_t *pair = of->pair + 2 * chosen[i];
        double n[3], p[3], arm[3];
        for (int r = 0; r < 3; r++) n[r] = normal[r * k + i], p[r] = point[r * k + i];
        cross3(p, n, arm);
        add_line(tree, state, of->joint[pair[0]], n, arm, 1.0, rows + i * tree->nv);
        add_line(tree, state, of->joint[pair[1]], n, arm, -1.0, rows + i * tree->nv);
    }
    return 0;
}
