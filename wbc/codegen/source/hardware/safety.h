/* The safety layer: limits of commands, and reactions to faults.
 *
 * It is independent of the controller. In each cycle it gets readings and faults (wbc_safety_report), judges them by
 * one table (wbc_rules), changes its mode by another (wbc_transitions), and admits commands within limits only
 * (wbc_safety_admit). Tables and limits are in data.c; the same layer in Python is wbc/hardware/safety.py.
 */
#ifndef WBC_SAFETY_H
#define WBC_SAFETY_H

#include "data.h"

/* A command of the motors: tau = torque + kp (position - q) + kd (velocity - q'). */
typedef struct {
    double position[WBC_JOINTS], velocity[WBC_JOINTS], torque[WBC_JOINTS], kp[WBC_JOINTS], kd[WBC_JOINTS];
    int enabled; /* whether motors are powered at all */
} wbc_motors;

/* One message of the robot. */
typedef struct {
    int64_t sequence;
    double time; /* of the measurement, by the robot's clock */
    double position[WBC_JOINTS], velocity[WBC_JOINTS], torque[WBC_JOINTS], temperature[WBC_JOINTS];
    double quaternion[4]; /* x y z w, of the IMU to the world */
    double rate[3], force[3];
    int stop; /* the stop button */
} wbc_reading;

typedef struct {
    int mode;
    wbc_motors last, brake, off;
    int reported, order[WBC_FAULTS]; /* faults of this cycle, in order */
    double borne[WBC_FAULTS];        /* s: how long each fault has been present; 0: absent */
    int64_t counts[WBC_FAULTS];      /* cycles with each fault */
    int measured;                    /* whether there was a reading */
    double q[WBC_JOINTS], v[WBC_JOINTS];
    int cause; /* the fault that caused the last stop; -1: none */
} wbc_safety;

void wbc_safety_start(wbc_safety *s);
/* Change the mode; 0: not allowed from this one, or with a fault present. */
int wbc_safety_to(wbc_safety *s, int mode);
int wbc_safety_arm(wbc_safety *s);
int wbc_safety_reset(wbc_safety *s);
int wbc_safety_stand_up(wbc_safety *s);
/* From all modes but idle, which moves nothing. */
void wbc_safety_stop(wbc_safety *s);
/* Report a fault in this cycle. */
void wbc_safety_report(wbc_safety *s, int fault);
/* Check an accepted reading: joints, motors, tilt, button. */
void wbc_safety_measured(wbc_safety *s, const wbc_reading *reading);
/* Judge the faults of the cycle: one that lasts beyond its patience changes the mode. Returns the mode. */
int wbc_safety_judge(wbc_safety *s);
/* Return the command to send: wanted within limits, or the last one if wanted is 0. */
const wbc_motors *wbc_safety_admit(wbc_safety *s, const wbc_motors *wanted);
/* A joint's position in the turn nearest to another one: encoders without a range begin anew after a turn. */
double wbc_nearest_turn(int j, double position, double to);
/* Motor torques of a command at a state, before their limits. */
void wbc_motor_torque(const wbc_motors *c, const double *q, const double *v, double *torque);

#endif
