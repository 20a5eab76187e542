/* The controller of one problem, in C: no Python, no allocation of its own, no globals.
 *
 *     static wbc_controller c;
 *     if (wbc_start(&c) != DONE) ...
 *     every WBC_DT seconds:
 *         wbc_set_target(&c, WBC_TASK_COM, com, com_velocity, 0);
 *         if (wbc_control(&c, q, v, &command) != DONE) ...
 *
 * Units are SI. q: base position, base quaternion x y z w, joints; v: the base's linear and angular
 * velocity in the base's axes, joint rates; the order of the joints: wbc_joint_names.
 */
#ifndef WBC_CONTROLLER_H
#define WBC_CONTROLLER_H

#include "plan.h"

/* A controller and its memory. It contains pointers into itself: do not move or copy it after wbc_start. */
typedef struct {
    wbc_plan plan;
    double number[WBC_NUMBERS], state[WBC_STATE], out[WBC_OUT], scratch[WBC_SCRATCH];
    int64_t order[WBC_ORDER];
} wbc_controller;

typedef struct {
    double velocity[WBC_NV];   /* at the end of the tick */
    double torque[WBC_NV - 6]; /* within its bounds; zeros at the velocity level */
} wbc_command;

/* In addition to core.h's enum status: UNSOLVED, INFEASIBLE and so on. */
enum { NO_TARGET = -3 };

/* Initialise, with the targets of the first tick of the problem. Returns DONE. */
int wbc_start(wbc_controller *c);

/* Set the target of a task or contact, its rate and acceleration; 0: zeros.
 *
 *     WBC_KIND_...       target                                rate, acceleration
 *     POINT              position (3), world axes              (3)
 *     ORIENTATION        rotation (3, 3), local to world       angular (3), world axes
 *     POINTING           direction (3) of length 1, world axes (3), of a length that stays 1
 *     INERTIA_ENTRIES    inertia xx xy xz yy yz zz             (6)
 *     JOINTS             positions of all joints               (WBC_NV - 6)
 *     MOMENTUM_ENTRIES   linear, angular (6)                   rate only (6)
 *     CONTACT            position (3), rotation (3, 3)         none
 *
 * A task of some entries ignores the others. If a number is not finite, wbc_control returns
 * NOT_FINITE. NO_TARGET: there is no such part, or it has no target. */
int wbc_set_target(wbc_controller *c, int part, const double *target, const double *rate, const double *acceleration);
/* The sizes of these three; NO_TARGET as above. */
int wbc_target_sizes(int part, int sizes[3]);

/* Compute the command at a measured state; v may be 0: at rest. Its KKT residuals
 * are at most WBC_EPS. Other than DONE: there is no command, and the caller needs a fallback. */
int wbc_control(wbc_controller *c, const double q[WBC_NQ], const double *v, wbc_command *command);

#endif
