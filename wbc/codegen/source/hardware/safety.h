/* The safety layer: what a robot may be told, and what is done when something goes wrong.
 *
 * It knows nothing of the controller. In each cycle it is told what the sensors said and what went wrong
 * (wbc_safety_report), judges by one table (wbc_rules), changes its mode by another (wbc_transitions), and
 * lets a command pass only within limits (wbc_safety_admit). Tables and limits are in data.c; the same layer
 * in Python is wbc/hardware/safety.py.
 */
#ifndef WBC_SAFETY_H
#define WBC_SAFETY_H

#include "data.h"

/* What motors are told: tau = torque + kp (position - q) + kd (velocity - q'). */
typedef struct {
    double position[WBC_JOINTS], velocity[WBC_JOINTS], torque[WBC_JOINTS], kp[WBC_JOINTS], kd[WBC_JOINTS];
    int enabled; /* whether motors are powered at all */
} wbc_motors;

/* One message of a robot, as it came. */
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
    int reported, order[WBC_FAULTS]; /* in this cycle, in this order */
    double borne[WBC_FAULTS];        /* for how long [s]; 0: not */
    int64_t counts[WBC_FAULTS];      /* how many cycles had each */
    int measured;                    /* whether there was a reading */
    double q[WBC_JOINTS], v[WBC_JOINTS];
    int cause; /* the fault of the last judgement that stopped it, -1: none did */
} wbc_safety;

void wbc_safety_start(wbc_safety *s);
/* Change the mode, by hand or as it goes; 0: not allowed from here, or with a fault that is borne. */
int wbc_safety_to(wbc_safety *s, int mode);
int wbc_safety_arm(wbc_safety *s);
int wbc_safety_reset(wbc_safety *s);
int wbc_safety_stand_up(wbc_safety *s);
/* From all modes that move; from idle there is nothing to stop. */
void wbc_safety_stop(wbc_safety *s);
/* Tell of a fault in this cycle. */
void wbc_safety_report(wbc_safety *s, int fault);
/* Look at a usable reading: joints, motors, tilt, button. */
void wbc_safety_measured(wbc_safety *s, const wbc_reading *reading);
/* End a cycle's reports: change the mode where a fault was borne for too long. Returns the mode. */
int wbc_safety_judge(wbc_safety *s);
/* Return what the robot is told: wanted within limits; the last command if that is 0. */
const wbc_motors *wbc_safety_admit(wbc_safety *s, const wbc_motors *wanted);
/* What motors make of a command at a state, before their limits. */
void wbc_motor_torque(const wbc_motors *c, const double *q, const double *v, double *torque);

#endif
