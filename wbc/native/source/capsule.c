/* The capsule of a small volume round points: Nelder and Mead's search for its ends, by their own
 * coefficients (The Computer Journal 7, 1965). See wbc/robot/collision/fitting.py. */
#include "core.h"

#include <math.h>
#include <string.h>

enum { ENDS = 6, CORNERS = ENDS + 1, MOST_STEPS = 600 };
static const double SAME_PLACE = 1e-5; /* m, of the simplex's corners: the search is over */
static const double SAME_VOLUME = 1e-12; /* m^3 */
static const double PI = 3.14159265358979323846;

/* Volume of the capsule with two ends (6) that holds points (count, 3). */
static double volume(int64_t count, const double *points, const double *ends) {
    double along[3], squared = 0.0, far = 0.0;
    for (int i = 0; i < 3; i++) {
        along[i] = ends[3 + i] - ends[i];
        squared += along[i] * along[i];
    }
    for (int64_t k = 0; k < count; k++) {
        const double *p = points + 3 * k;
        const double x = p[0] - ends[0], y = p[1] - ends[1], z = p[2] - ends[2];
        double share = 0.0;
        if (squared > 0.0) share = (x * along[0] + y * along[1] + z * along[2]) / squared;
        share = share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share;
        const double a = x - share * along[0], b = y - share * along[1], c = z - share * along[2];
        const double apart = a * a + b * b + c * c;
        far = apart > far ? apart : far;
    }
    const double r = sqrt(far);
    return PI * far * (sqrt(squared) + 4.0 / 3.0 * r);
}

typedef struct {
    double ends[ENDS], volume;
} corner;

static void sort(corner *simplex) {
    for (int i = 1; i < CORNERS; i++) {
        const corner one = simplex[i];
        int j = i;
        for (; j > 0 && simplex[j - 1].volume > one.volume; j--) simplex[j] = simplex[j - 1];
        simplex[j] = one;
    }
}

static int is_small(const corner *simplex) {
    for (int k = 1; k < CORNERS; k++) {
        if (fabs(simplex[k].volume - simplex[0].volume) > SAME_VOLUME) return 0;
        for (int i = 0; i < ENDS; i++)
            if (fabs(simplex[k].ends[i] - simplex[0].ends[i]) > SAME_PLACE) return 0;
    }
    return 1;
}

/* The point of the line from the worst corner through the middle, so many times beyond it. */
static corner beyond(const corner *worst, const double *middle, double times, int64_t count,
                     const double *points) {
    corner out;
    for (int i = 0; i < ENDS; i++)
        out.ends[i] = (1.0 + times) * middle[i] - times * worst->ends[i];
    out.volume = volume(count, points, out.ends);
    return out;
}

int wbc_capsule(int64_t count, const double *points, double size, double *ends, double *found) {
    corner simplex[CORNERS];
    for (int k = 0; k < CORNERS; k++) {
        memcpy(simplex[k].ends, ends, sizeof simplex[k].ends);
        if (k > 0) simplex[k].ends[k - 1] += size;
        simplex[k].volume = volume(count, points, simplex[k].ends);
    }
    sort(simplex);
    corner *worst = simplex + ENDS;
    for (int step = 1; step < MOST_STEPS && !is_small(simplex); step++) {
        double middle[ENDS] = {0};
        for (int k = 0; k < ENDS; k++)
            for (int i = 0; i < ENDS; i++) middle[i] += simplex[k].ends[i];
        for (int i = 0; i < ENDS; i++) middle[i] /= ENDS;
        const corner reflected = beyond(worst, middle, 1.0, count, points);
        if (reflected.volume < simplex[0].volume) {
            const corner expanded = beyond(worst, middle, 2.0, count, points);
            *worst = expanded.volume < reflected.volume ? expanded : reflected;
        } else if (reflected.volume < worst[-1].volume) {
            *worst = reflected;
        } else {
            const int outside = reflected.volume < worst->volume;
            const corner contracted = beyond(worst, middle, outside ? 0.5 : -0.5, count, points);
            const double most = outside ? reflected.volume : worst->volume;
            if (outside ? contracted.volume <= most : contracted.volume < most) {
                *worst = contracted;
            } else {
                for (int k = 1; k < CORNERS; k++) {
                    for (int i = 0; i < ENDS; i++)
                        simplex[k].ends[i] =
                            simplex[0].ends[i] + 0.5 * (simplex[k].ends[i] - simplex[0].ends[i]);
                    simplex[k].volume = volume(count, points, simplex[k].ends);
                }
            }
        }
        sort(simplex);
    }
    memcpy(ends, simplex[0].ends, sizeof simplex[0].ends);
    *found = simplex[0].volume;
    return 0;
}
