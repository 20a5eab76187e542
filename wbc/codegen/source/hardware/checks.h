/* Whether readings can be believed: order, age, range, and sensors against each other. The same in Python:
 * wbc/hardware/sensor_checks.py; its thresholds are in data.h. */
#ifndef WBC_CHECKS_H
#define WBC_CHECKS_H

#include "safety.h"

enum { WBC_PAST = 64, WBC_AGREEING = 16 }; /* readings kept of a window; of a new clock */

typedef struct {
    int64_t sequence;
    wbc_reading past[WBC_PAST]; /* a ring: usable ones of the last window */
    int first, count;
    double velocities[WBC_JOINTS], spins[3]; /* their sums */
    int knows_offset, strangers;
    double offset, strange[WBC_AGREEING]; /* of the robot's clock from ours, at its freshest */
    double jumped_back;                   /* in sum [s]; added to times, they go on */
    double changed[2];                    /* when a bit of gyroscope and accelerometer last did */
    double gravity[3];                    /* mean specific force, world axes */
    double weighed;                       /* when that was last what a robot weighs */
} wbc_checks;

void wbc_checks_start(wbc_checks *c);
/* Return why a reading, taken from the bus at now, is of no use: a fault; -1: it is of use. Its time is made to
 * go on where the robot's clock jumped. */
int wbc_checks_refused(wbc_checks *c, wbc_reading *reading, double now);
/* Report what a reading of use shows: sensors that contradict each other, or are frozen. commanded: torques
 * that motors should have now; 0: not known. */
void wbc_checks_compared(wbc_checks *c, const wbc_reading *reading, const double *commanded, wbc_safety *s);

/* R (3, 3): the rotation of a unit quaternion x y z w. */
void wbc_rotation(const double *quaternion, double *R);

#endif
