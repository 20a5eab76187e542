/* KKT residuals of a solution, whoever found it (Boyd & Vandenberghe, Convex Optimization, sec. 5.5.3, with
 * two-sided rows and bounds). */
#include "linear.h"
#include "problem.h"

#include <math.h>

/* The larger one, or NaN. */
static double worse(double one, double other) { return one != one || other <= one ? one : other; }

/* Add the primal and the complementarity residual of a value between two bounds with multiplier z. */
static void add_bound_residuals(double value, double lower, double upper, double z, double *found) {
    const double above = upper - value, below = value - lower;
    const double slack = fabs(z > 0.0 ? above : below), size = fabs(z);
    found[0] = worse(worse(found[0], -above), -below);
    found[2] = worse(found[2], slack < size ? slack : size);
}

WIDE void residuals(const wbc_qp *qp, const double *compliance, double *gradient) {
    const int64_t n = qp->n;
    double *found = qp->found;
    found[0] = found[1] = found[2] = 0.0;
    for (int64_t i = 0; i < n; i++) add_bound_residuals(qp->x[i], qp->lower[i], qp->upper[i], qp->z_box[i], found);
    for (int64_t r = 0; r < qp->k; r++) found[0] = worse(found[0], fabs(dot(n, qp->A + r * n, qp->x) - qp->b[r]));
    add_rows(n, qp->k, qp->y, qp->A, n, gradient);
    for (int64_t r = 0; r < qp->m; r++) {
        const double slack_allowed = compliance ? compliance[r] * qp->z[r] : 0.0;
        add_bound_residuals(dot(n, qp->C + r * n, qp->x) - slack_allowed, qp->l[r], qp->u[r], qp->z[r], found);
    }
    for (int64_t i = 0; i < n; i++) found[1] = worse(found[1], fabs(gradient[i]));
}

int wbc_residuals(const wbc_qp *qp, double *gradient) {
    const int64_t n = qp->n;
    for (int64_t i = 0; i < n; i++) gradient[i] = qp->g[i] + qp->z_box[i];
    add_slope(qp, qp->x, gradient);
    add_rows(n, qp->m, qp->z, qp->C, n, gradient);
    residuals(qp, 0, gradient);
    return DONE;
}
