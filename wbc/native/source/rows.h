/* The rows of tasks and contacts, one block at a time. */
#ifndef WBC_ROWS_H
#define WBC_ROWS_H

#include "core.h"
#include "linear.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* Position of a joint [rad or m]; start is negative, and one less, where q holds (cos, sin). */
double joint_position(const wbc_plan *plan, const double *q, int64_t joint);

/* Write the errors e and the Jacobian J (rows, nv) of a block, its bias, and a bound on its neglected curvature.
 * Joints among the costs get no J. */
void evaluate_block(const wbc_plan *plan, const wbc_block *block, const double *state, const double *frames,
                    const double *q, double *J, double *e, double *bias, double *bound);

/* The curvature of an inertia block with errors e, not in the bound above: add factor times the rows' absolute sums
 * to to (nv), stride apart; or add it to H (nv, nv). work holds 14 (nv + 3)
 * numbers. */
void damp_by_curvature(const wbc_plan *plan, const wbc_block *block, const double *state, const double *frames,
                       const double *e, double factor, double *work, double *to, int64_t stride);
void add_curvature(const wbc_plan *plan, const wbc_block *block, const double *state, const double *frames,
                   const double *e, double *work, double *H);

/* Write scale times the Jacobian of a LOOP, rows apart and columns stride apart, and its errors unless 0; and
 * second derivatives (6) of all rows it may have. Source: loops.c. */
void loop_rows(const wbc_plan *plan, const wbc_block *block, const double *state, double scale, double *rows,
               int64_t apart, int64_t stride, double *errors);
void loop_drift(const wbc_plan *plan, const wbc_block *block, const double *state, const double *motion,
                const double *v, double *out);

/* Return the error of a GEAR from its numbers, and write its row as loop_rows does; return its drift. */
double gear_row(const wbc_plan *plan, const double *gear, const double *q, double scale, double *row, int64_t stride);
double gear_drift(const wbc_plan *plan, const double *gear, const double *q, const double *v);

/* Second derivatives of a block's errors e at zero acceleration of v; the accelerations (6) are
 * those of the plan's frames. */
void block_drift(const wbc_plan *plan, const wbc_block *block, const double *state, const double *frames,
                 const double *motion, const double *accelerations, const double *q, const double *v, const double *e,
                 double *drift);

#pragma GCC visibility pop

#endif
