/* A small capsule round points: Nelder and Mead's simplex search (1965; as in SciPy's minimize) over its two ends;
 * the radius is the distance of the farthest point. */
#include "core.h"
#include "linear.h"

#include <string.h>

enum { ENDS = 6, CORNERS = ENDS + 1 }; /* unknowns, corners of a simplex */

/* The square of the farthest point's distance from a segment. */
static double farthest(int64_t count, const double *points, const double *begin, const double *along,
                       double squared) {
    double most = 0.0;
    for (int64_t k = 0; k < count; k++) {
        const double *p = points + 3 * k;
        const double to[3] = {p[0] - begin[0], p[1] - begin[1], p[2] - begin[2]};
        double share = squared > 0.0 ? dot3(to, along) / squared : 0.0;
        share = share < 1.0 ? share : 1.0, share = share > 0.0 ? share : 0.0;
        const double x = p[0] - (begin[0] + share * along[0]);
        const double y = p[1] - (begin[1] + share * along[1]);
        const double z = p[2] - (begin[2] + share * along[2]);
        const double distance = x * x + y * y + z * z;
        if (distance > most) most = distance;
    }
    return most;
}

static double volume(int64_t count, const double *points, const double *ends) {
    const double along[3] = {ends[3] - ends[0], ends[4] - ends[1], ends[5] - ends[2]};
    const double squared = dot3(along, along);
    const double r = sqrt(farthest(count, points, ends, along, squared));
    return PI * r * r * (sqrt(squared) + 4.0 / 3.0 * r);
}

typedef struct {
    double at[CORNERS][ENDS], value[CORNERS];
} simplex;

/* Sort by value, stable. */
static void sort(simplex *s) {
    for (int i = 1; i < CORNERS; i++) {
        double at[ENDS];
        const double value = s->value[i];
        int j = i;
        memcpy(at, s->at[i], sizeof at);
        for (; j > 0 && value < s->value[j - 1]; j--) {
            memcpy(s->at[j], s->at[j - 1], sizeof at);
            s->value[j] = s->value[j - 1];
        }
        memcpy(s->at[j], at, sizeof at);
        s->value[j] = value;
    }
}

static int is_small(const simplex *s, double accuracy, double value_accuracy) {
    for (int i = 1; i < CORNERS; i++) {
        if (!(fabs(s->value[0] - s->value[i]) <= value_accuracy)) return 0;
        for (int j = 0; j < ENDS; j++)
            if (!(fabs(s->at[i][j] - s->at[0][j]) <= accuracy)) return 0;
    }
    return 1;
}

/* Reflect the worst corner at the centroid of the others, by a factor. */
static double tried(int64_t count, const double *points, const simplex *s, double part, double *at) {
    for (int j = 0; j < ENDS; j++) {
        double middle = 0.0;
        for (int i = 0; i < CORNERS - 1; i++) middle += s->at[i][j];
        at[j] = (1.0 + part) * (middle / ENDS) - part * s->at[CORNERS - 1][j];
    }
    return volume(count, points, at);
}

static void replace(simplex *s, const double *at, double value) {
    memcpy(s->at[CORNERS - 1], at, sizeof s->at[0]);
    s->value[CORNERS - 1] = value;
}

int wbc_fit_capsule(int64_t count, const double *points, double size, int64_t most, double accuracy,
                    double value_accuracy, double *ends) {
    simplex s;
    for (int i = 0; i < CORNERS; i++) {
        memcpy(s.at[i], ends, sizeof s.at[i]);
        if (i) s.at[i][i - 1] += size;
        s.value[i] = volume(count, points, s.at[i]);
    }
    sort(&s);
    for (int64_t k = 1; k < most && !is_small(&s, accuracy, value_accuracy); k++) {
        double once[ENDS], other[ENDS];
        const double first = tried(count, points, &s, 1.0, once), worst = s.value[CORNERS - 1];
        if (first < s.value[0]) { /* expand */
            const double second = tried(count, points, &s, 2.0, other);
            if (second < first) replace(&s, other, second);
            else replace(&s, once, first);
        } else if (first < s.value[CORNERS - 2]) replace(&s, once, first);
        else { /* contract, on the better side */ const int outside = first < worst;
            const double second = tried(count, points, &s, outside ? 0.5 : -0.5, other);
            if (outside ? second <= first : second < worst) replace(&s, other, second);
            else
                for (int i = 1; i < CORNERS; i++) {
                    for (int j = 0; j < ENDS; j++) s.at[i][j] = s.at[0][j] + 0.5 * (s.at[i][j] - s.at[0][j]);
                    s.value[i] = volume(count, points, s.at[i]);
                }
        }
        sort(&s);
    }
    memcpy(ends, s.at[0], sizeof s.at[0]);
    return 0;
}
