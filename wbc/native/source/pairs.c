/* The nearest pairs of convex bodies of a robot and their rows; see wbc/robot/collision. Capsules are segments with
 * a radius, other bodies hulls of corners. */
#include "core.h"
#include "convex.h"
#include "linear.h"
#include "margin.h"
#include "tree.h"

#include <string.h>

static const double PARALLEL = 1e-10; /* squared sine of the angle below which segments count as parallel */
static const double TOUCHING = 1e-9;  /* m: between closer axes there is no direction */
static const double TIE = 1e-9;       /* m: clearances closer than this are a tie, and lower numbers win */

/* A placed body: start, unit direction and middle, world axes; a half-space: point, normal, point. */
enum { START = 0, DIRECTION = 3, MIDDLE = 6, PLACED = 9 };
enum { LENGTH = 0, RADIUS = 1, REACH = 2, SIZES = 3 };
enum { FOUND = 7 }; /* distance, normal, point on the first body */

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

static double clamp(double x, double length) {
    const double least = x > 0.0 ? x : 0.0;
    return least < length ? least : length;
}

/* Write the part of x perpendicular to an axis; returns whether it has a length. */
static int perpendicular(const double *x, const double *axis, double *n) {
    const double squared = dot3(axis, axis), share = squared > 0.0 ? dot3(x, axis) / squared : 0.0;
    for (int i = 0; i < 3; i++) n[i] = x[i] - share * axis[i];
    return dot3(n, n) > TOUCHING * TOUCHING;
}

/* A unit vector that separates segments a, b whose axes touch: perpendicular to both, towards a's middle. */
static void separating_direction(const double *a, const double *b, const double *between, double *n) {
    static const double up[3] = {0.0, 0.0, 1.0}, ahead[3] = {1.0, 0.0, 0.0}; /* one of them is not parallel to the
                                                                              * axis */
    const double aa = dot3(a, a), bb = dot3(b, b), *axis = aa >= bb ? a : b;
    double middles[3];
    for (int i = 0; i < 3; i++) middles[i] = between[i] + 0.5 * (a[i] - b[i]);
    cross3(a, b, n);
    if (dot3(n, n) <= PARALLEL * aa * bb && !perpendicular(middles, axis, n) && !perpendicular(up, axis, n))
        perpendicular(ahead, axis, n);
    const double length = sqrt(dot3(n, n)), sign = dot3(n, middles) < 0.0 ? -1.0 : 1.0;
    for (int i = 0; i < 3; i++) n[i] *= sign / length;
}

/* Of two capsules. Ericson, Real-Time Collision Detection (2005), sec. 5.1.9. */
static void measure_capsules(const wbc_pairs *of, const double *placed, int64_t pair, double *found) {
    const int64_t first = of->pair[2 * pair], second = of->pair[2 * pair + 1];
    const double *A = placed + PLACED * first, *B = placed + PLACED * second;
    const double *a = A + DIRECTION, *b = B + DIRECTION;
    const double *own = of->size + SIZES * first, *other = of->size + SIZES * second;
    double between[3], apart[3], along[2][3];
    for (int i = 0; i < 3; i++) between[i] = A[i] - B[i];
    const double ab = dot3(a, b), ar = dot3(a, between), br = dot3(b, between);
    const double sine = 1.0 - ab * ab > PARALLEL ? 1.0 - ab * ab : PARALLEL;
    const double near = clamp((ab * br - ar) / sine, own[LENGTH]);
    const double t = clamp(ab * near + br, other[LENGTH]);
    const double s = clamp(ab * t - ar, own[LENGTH]);
    for (int i = 0; i < 3; i++) apart[i] = between[i] + s * a[i] - t * b[i];
    const double distance = sqrt(dot3(apart, apart));
    found[0] = distance - own[RADIUS] - other[RADIUS];
    for (int i = 0; i < 3; i++) found[1 + i] = apart[i] / distance;
    if (distance < TOUCHING) {
        for (int i = 0; i < 3; i++) along[0][i] = own[LENGTH] * a[i], along[1][i] = other[LENGTH] * b[i];
        separating_direction(along[0], along[1], between, found + 1);
    }
    for (int i = 0; i < 3; i++) found[4 + i] = A[i] + s * a[i] - own[RADIUS] * found[1 + i];
}

/* Of two hulls; -INFINITY where convex_distance has no answer, since they overlap. */
static void measure_hulls(const wbc_pairs *of, const double *state, const double *placed, int64_t pair, double limit,
                          double *found) {
    const double *rotations = state + ROTATIONS(of->nv);
    const double *origins = state + ORIGINS(of->nv, of->joints), *origin[2];
    convex hull[2];
    double there[3], guess[3];
    for (int k = 0; k < 2; k++) {
        const int64_t body = of->pair[2 * pair + k], begin = of->first[body];
        hull[k].corner = of->corner + begin, hull[k].stride = of->first[of->bodies];
        hull[k].n = of->first[body + 1] - begin;
        hull[k].R = rotations + 9 * of->joint[body];
        origin[k] = origins + 3 * of->joint[body];
    }
    const int64_t first = of->pair[2 * pair], second = of->pair[2 * pair + 1];
    for (int i = 0; i < 3; i++) {
        there[i] = origin[1][i] - origin[0][i];
        guess[i] = placed[PLACED * first + MIDDLE + i] - placed[PLACED * second + MIDDLE + i];
    }
    const double rounding = of->rounding[first] + of->rounding[second];
    if (!convex_distance(hull, hull + 1, there, guess, limit + rounding, found, found + 1, found + 4)) {
        memset(found, 0, FOUND * sizeof *found);
        found[0] = -INFINITY;
        return;
    }
    found[0] -= rounding;
    for (int i = 0; i < 3; i++) found[4 + i] += origin[0][i] - of->rounding[first] * found[1 + i];
}

/* Of a hull and a half-space: by the lowest corner. */
static void measure_above(const wbc_pairs *of, const double *state, const double *placed, int64_t pair,
                          double *found) {
    const int64_t body = of->pair[2 * pair], corners = of->first[of->bodies];
    const double *R = state + ROTATIONS(of->nv) + 9 * of->joint[body];
    const double *p = state + ORIGINS(of->nv, of->joints) + 3 * of->joint[body];
    const double *plane = placed + PLACED * of->pair[2 * pair + 1], *n = plane + DIRECTION;
    found[0] = INFINITY;
    for (int64_t c = of->first[body]; c < of->first[body + 1]; c++) {
        const double local[3] = {of->corner[c], of->corner[corners + c], of->corner[2 * corners + c]};
        double corner[3], height = -of->rounding[body];
        times3(R, local, corner);
        for (int i = 0; i < 3; i++) corner[i] += p[i], height += n[i] * (corner[i] - plane[i]);
        if (height >= found[0]) continue;
        found[0] = height;
        for (int i = 0; i < 3; i++) found[4 + i] = corner[i] - of->rounding[body] * n[i];
    }
    memcpy(found + 1, n, 3 * sizeof *n);
}

/* Of any pair. Above the limit, a lower bound of the distance may be written instead, without normal and point. */
static void measure(const wbc_pairs *of, const double *state, const double *placed, int64_t pair, double limit,
                    double *found) {
    if (of->kind[pair] == ABOVE) {
        measure_above(of, state, placed, pair, found);
        return;
    }
    measure_capsules(of, placed, pair, found);
    if (of->kind[pair] == HULLS && !(found[0] > limit)) measure_hulls(of, state, placed, pair, limit, found);
}

/* The k-th smallest (from 0) of n values, which are reordered: Hoare's selection. */
static double kth_smallest(double *values, int64_t n, int64_t k) {
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
        if (k <= j) high = j;
        else if (k >= i) low = i;
        else break;
    }
    return values[k];
}

/* Replace the largest of n values, the last one; returns what is the largest then, and moves it there. */
static double replace_largest(double *values, int64_t n, double value) {
    int64_t largest = n - 1;
    values[n - 1] = value;
    for (int64_t i = 0; i < n; i++)
        if (values[i] > values[largest]) largest = i;
    value = values[largest];
    values[largest] = values[n - 1];
    return values[n - 1] = value;
}

/* Bound the speeds of the points of each body, by the twists of the joints. */
static void bound_speeds(const wbc_pairs *of, const wbc_closing *closing, const double *placed, double *most) {
    for (int64_t b = 0; b < of->bodies; b++) {
        const double *T = closing->twist + 6 * closing->carrier[b], *c = placed + PLACED * b + MIDDLE;
        double at[3];
        cross3(T + 3, c, at);
        for (int i = 0; i < 3; i++) at[i] += T[i];
        most[b] = sqrt(dot3(at, at)) + sqrt(dot3(T + 3, T + 3)) * of->size[SIZES * b + REACH];
    }
}

/* Velocity of the second body of a pair relative to the first, at a point; returns the square of its angular
 * velocity. */
static double relative_motion(const wbc_pairs *of, const wbc_closing *closing, int64_t pair, const double *point,
                              double *at) {
    const double *A = closing->twist + 6 * closing->carrier[of->pair[2 * pair]];
    const double *B = closing->twist + 6 * closing->carrier[of->pair[2 * pair + 1]];
    const double turn[3] = {B[3] - A[3], B[4] - A[4], B[5] - A[5]};
    cross3(turn, point, at);
    for (int i = 0; i < 3; i++) at[i] += B[i] - A[i];
    return dot3(turn, turn);
}

/* The closing speed of a measured pair. */
static double closing_speed(const wbc_pairs *of, const wbc_closing *closing, int64_t pair, const double *found) {
    double at[3];
    relative_motion(of, closing, pair, found + 4, at);
    return dot3(at, found + 1);
}

/* Bound the stopping distance of a pair by its relative motion: tighter than by the speeds of its bodies. */
static double longest_stopping_distance(const wbc_pairs *of, const wbc_closing *closing, const double *placed,
                                        int64_t pair) {
    const int64_t first = of->pair[2 * pair];
    double at[3];
    const double turn = relative_motion(of, closing, pair, placed + PLACED * first + MIDDLE, at);
    const double most = sqrt(dot3(at, at)) + sqrt(turn) * of->size[SIZES * first + REACH];
    return stopping_distance(closing, most);
}

/* Lower bounds of the distances, less the margins, by bounding balls; false: one is NaN. */
static int bound_by_balls(const wbc_pairs *of, const double *placed, const double *less, double *lower) {
    for (int64_t p = 0; p < of->pairs; p++) {
        const int64_t a = of->pair[2 * p], b = of->pair[2 * p + 1];
        const double *A = placed + PLACED * a + MIDDLE, *B = placed + PLACED * b + MIDDLE;
        const double apart[3] = {A[0] - B[0], A[1] - B[1], A[2] - B[2]}, *n = placed + PLACED * b + DIRECTION;
        const double way = of->kind[p] == ABOVE ? dot3(apart, n) : sqrt(dot3(apart, apart));
        lower[p] = way - of->size[SIZES * a + REACH] - of->size[SIZES * b + REACH] - less[p];
        if (!(lower[p] < INFINITY)) return 0;
    }
    return 1;
}

/* What most_urgent_pairs knows of each pair: a lower bound of its clearance; what is taken off its distance; and what
 * was measured, INFINITY before. */
typedef struct {
    const wbc_pairs *of;
    const double *state, *placed;
    const wbc_closing *closing;
    double *lower, *less, *found;
    int64_t overlapping;
} search;

/* Measure a pair and return its clearance; INFINITY: it is above the limit. By capsules, hulls are only bounded. */
static double clearance_of(search *s, int64_t p, int by_capsules, double limit) {
    double *own = s->found + FOUND * p;
    if (own[0] < INFINITY) return own[0] - s->less[p];
    const int hulls = s->of->kind[p] == HULLS;
    const double braking = hulls && s->closing ? longest_stopping_distance(s->of, s->closing, s->placed, p) : 0.0;
    if (hulls && by_capsules) {
        measure_capsules(s->of, s->placed, p, own);
        own[0] -= braking;
        return own[0] - s->less[p];
    }
    const double most = hulls ? limit + s->less[p] + braking : INFINITY;
    measure(s->of, s->state, s->placed, p, most, own);
    if (own[0] > most) return own[0] = INFINITY;
    if (own[0] == -INFINITY) s->overlapping++;
    if (s->closing) s->less[p] += stopping_distance(s->closing, closing_speed(s->of, s->closing, p, own));
    return own[0] - s->less[p];
}

int most_urgent_pairs(const wbc_pairs *of, const double *state, int64_t count, const double *kept,
                      const wbc_closing *closing, double *scratch, int64_t *chosen, double *nearest) {
    const int64_t pairs = of->pairs;
    double *placed = scratch, *speed = placed + PLACED * of->bodies, *lower = speed + of->bodies;
    double *less = lower + pairs, *sorted = less + pairs, *found = sorted + pairs;
    const double tie = closing ? TIE : 0.0; /* among ties the lowest numbers */
    search s = {of, state, placed, closing, lower, less, found, 0};
    double limit = INFINITY;
    int64_t k = 0, beyond = 0;
    if (count < 1 || pairs < count) return -1;
    place_bodies(of, state, placed);
    if (kept) memcpy(less, kept, pairs * sizeof *less);
    else memset(less, 0, pairs * sizeof *less);
    if (!bound_by_balls(of, placed, less, lower)) return -1;
    if (closing) {
        bound_speeds(of, closing, placed, speed);
        for (int64_t p = 0; p < pairs; p++) /* the speed of a turning half-space is not bounded */
            lower[p] -= of->kind[p] == ABOVE
                            ? longest_stopping_distance(of, closing, placed, p)
                            : stopping_distance(closing, speed[of->pair[2 * p]] + speed[of->pair[2 * p + 1]]);
    }
    for (int64_t p = 0; p < pairs; p++) found[FOUND * p] = INFINITY;
    /* First hulls are bounded by the capsules around them, then measured. Each time the clearances of the count pairs
     * of least bounds bound the count-th one; then all others that may be below it are measured, and lower it. */
    for (int by_capsules = 1; by_capsules >= 0; by_capsules--) {
        int64_t measured = 0;
        memcpy(sorted, lower, pairs * sizeof *lower);
        const double first = kth_smallest(sorted, pairs, count - 1);
        for (int64_t p = 0; p < pairs; p++)
            if (lower[p] <= first) sorted[measured++] = clearance_of(&s, p, by_capsules, INFINITY);
        limit = kth_smallest(sorted, measured, count - 1);
        for (int64_t p = 0; p < pairs; p++) {
            if (lower[p] <= first || lower[p] > limit + tie) continue;
            const double own = clearance_of(&s, p, by_capsules, limit + tie);
            if (own < limit) limit = replace_largest(sorted, count, own);
        }
        for (int64_t p = 0; p < pairs && by_capsules; p++) {
            double *own = found + FOUND * p;
            if (own[0] == INFINITY) continue;
            lower[p] = own[0] - less[p];
            if (of->kind[p] == HULLS) own[0] = INFINITY;
        }
    }
    if (s.overlapping >= count) return -1;
    for (int64_t p = 0; p < pairs; p++) beyond += found[FOUND * p] - less[p] < limit - tie;
    beyond = count - beyond;
    for (int64_t p = 0; p < pairs && k < count; p++) {
        const double own = found[FOUND * p] - less[p];
        if (own < limit - tie || (own <= limit + tie && beyond-- > 0)) chosen[k++] = p;
    }
    for (int64_t i = 0; i < k; i++)
        for (int r = 0; r < FOUND; r++) nearest[r * k + i] = found[FOUND * chosen[i] + r];
    if (k < count) return -1;
    return closing && count < pairs && limit < 0.0; /* more pairs may be as urgent */
}

int wbc_nearest(const wbc_pairs *of, const double *state, int64_t count, const double *kept, double *scratch,
                int64_t *chosen, double *nearest) {
    return most_urgent_pairs(of, state, count, kept, 0, scratch, chosen, nearest);
}

int wbc_most_urgent_pairs(const wbc_pairs *of, const double *state, int64_t count, const double *kept,
                          const wbc_closing *closing, double *scratch, int64_t *chosen, double *nearest,
                          double *left) {
    const int status = most_urgent_pairs(of, state, count, kept, closing, scratch, chosen, nearest);
    const double *less = scratch + (PLACED + 1) * of->bodies + of->pairs;
    for (int64_t i = 0; i < count && status >= 0; i++) left[i] = nearest[i] - less[chosen[i]];
    return status;
}

int wbc_measure(const wbc_pairs *of, const double *state, int64_t k, const int64_t *chosen, double *scratch,
                double *nearest) {
    place_bodies(of, state, scratch);
    for (int64_t i = 0; i < k; i++) {
        const int64_t p = chosen[i];
        double found[FOUND];
        measure(of, state, scratch, p, INFINITY, found);
        for (int r = 0; r < FOUND; r++) nearest[r * k + i] = found[r];
    }
    return 0;
}

int64_t wbc_pairs_within(const wbc_pairs *of, const double *states, int64_t n, int64_t stride, double limit,
                         const double *kept, double *scratch, int64_t room, int64_t *chosen, double *nearest) {
    double *placed = scratch, *lower = placed + PLACED * of->bodies;
    int64_t k = 0;
    for (int64_t f = 0; f < n; f++) {
        const double *state = states + f * stride;
        place_bodies(of, state, placed);
        if (!bound_by_balls(of, placed, kept, lower)) return -1;
        for (int64_t p = 0; p < of->pairs; p++) {
            double found[FOUND];
            if (!(lower[p] < limit)) continue;
            measure(of, state, placed, p, limit + kept[p], found);
            if (!(found[0] - kept[p] < limit)) continue;
            if (k < room) {
                chosen[2 * k] = f, chosen[2 * k + 1] = p;
                memcpy(nearest + FOUND * k, found, sizeof found);
            }
            k++;
        }
    }
    return k;
}

int any_nearer(const wbc_pairs *of, const double *state, int64_t k, const int64_t *chosen, const double *limit,
               double *scratch) {
    double *placed = scratch, *lower = placed + PLACED * of->bodies, found[FOUND];
    place_bodies(of, state, placed);
    if (k < 0 && !bound_by_balls(of, placed, limit, lower)) return 1;
    for (int64_t i = 0; i < (k < 0 ? of->pairs : k); i++) {
        const int64_t p = k < 0 ? i : chosen[i];
        if (k < 0 && lower[p] >= 0.0) continue;
        measure(of, state, placed, p, limit[p], found);
        if (!(found[0] >= limit[p])) return 1;
    }
    return 0;
}

/* Add the force line [n, p x n] times the twists of the joints from one up to another above. */
static void add_line(const wbc_tree *tree, const double *state, int64_t joint, int64_t above, const double *n,
                     const double *arm, double sign, double *row) {
    const int64_t nv = tree->nv;
    const double *T = state + TWISTS(nv);
    for (int64_t j = joint, c; j > above; j = tree->parent[j])
        for (int64_t behind = columns_of(tree, j, &c); c < behind; c++) {
            double sum = 0.0;
            for (int i = 0; i < 3; i++) sum += n[i] * T[i * nv + c] + arm[i] * T[(3 + i) * nv + c];
            row[c] = sign * sum;
        }
}

/* The derivative (nv) of a pair's distance by v. */
static void pair_row(const wbc_pairs *of, const wbc_tree *tree, const double *state, int64_t p, const double *normal,
                     const double *point, double *row) {
    const int64_t *pair = of->pair + 2 * p, above = of->common[p];
    double arm[3];
    memset(row, 0, tree->nv * sizeof *row);
    cross3(point, normal, arm);
    add_line(tree, state, of->joint[pair[0]], above, normal, arm, 1.0, row);
    add_line(tree, state, of->joint[pair[1]], above, normal, arm, -1.0, row);
}

int wbc_pair_rows(const wbc_pairs *of, const wbc_tree *tree, const double *state, int64_t k, const int64_t *chosen,
                  const double *normal, const double *point, double *rows) {
    for (int64_t i = 0; i < k; i++) {
        double n[3], p[3];
        for (int r = 0; r < 3; r++) n[r] = normal[r * k + i], p[r] = point[r * k + i];
        pair_row(of, tree, state, chosen[i], n, p, rows + i * tree->nv);
    }
    return 0;
}

int wbc_rows_within(const wbc_pairs *of, const wbc_tree *tree, const double *states, int64_t stride, int64_t k,
                    const int64_t *chosen, const double *nearest, double *rows) {
    for (int64_t i = 0; i < k; i++, chosen += 2, nearest += FOUND)
        pair_row(of, tree, states + chosen[0] * stride, chosen[1], nearest + 1, nearest + 4, rows + i * tree->nv);
    return 0;
}
