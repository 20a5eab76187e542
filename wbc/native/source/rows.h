/* What tasks and contacts ask for, one block of rows at a time. */
#ifndef WBC_ROWS_H
#define WBC_ROWS_H

#include "core.h"
#include "linear.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* Position of a joint [rad or m]; start is negative, and one less, where q holds (cos, sin). */
double joint_position(const wbc_plan *plan, const double *q, int64_t joint);

/* Errors e and matrix J (rows, nv) of a block, its bias, and what curvature it leaves out. Joints among
 * the costs get no matrix. */
void evaluate(const wbc_plan *plan, const wbc_block *block, const double *state,
              const double *frames, const double *q, double *J, double *e, double *bias,
              double *bound);

/* What curvature an inertia block of errors e leaves out, which evaluate does not count: add factor times
 * the sums of its rows' sizes to to (nv), stride apart; add it to H (nv, nv). work holds WORK */
void damp_by_curvature(const wbc_plan *plan, const wbc_block *block, const double *state,
                       const double *frames, const double *e, double factor, double *work,
                       double *to, int64_t stride);
void add_curvature(const wbc_plan *plan, const wbc_block *block, const double *state,
                   const double *frames, const double *e, double *work, double *H);

/* Rotation vector (3) of R; near half a turn its axis is that of R + R', since sines say little there. */
void logarithm(const double *R, double *r);

/* The matrix of a LOOP, times scale, its rows apart and their entries (nv) stride apart, and if not 0 its errors;
 * second derivatives (6) of all that it could hold. Source: loops.c. */
void loop_rows(const wbc_plan *plan, const wbc_block *block, const double *state, double scale,
               double *rows, int64_t apart, int64_t stride, double *errors);
void loop_drift(const wbc_plan *plan, const wbc_block *block, const double *state,
                const double *motion, const double *v, double *out);

/* Return the error of a GEAR, whose numbers are given, and write its row as loop_rows does; its drift. */
double gear_row(const wbc_plan *plan, const double *gear, const double *q, double scale, double *row,
                int64_t stride);
double gear_drift(const wbc_plan *plan, const double *gear, const double *q, const double *v);

/* Second derivatives of a block's errors e at zero acceleration of v; the accelerations (6) are
 * those of the plan's frames. */
void drift_of(const wbc_plan *plan, const wbc_block *block, const double *state,
              const double *frames, const double *motion, const double *accelerations,
              const double *q, const double *v, const double *e, double *drift);

#pragma GCC visibility pop

#endif
