/* Plausibility of readings: order, age, range, and sensors against each other. The same in Python:
 * wbc/hardware/sensor_checks.py; thresholds are in data.h. */
#ifndef WBC_CHECKS_H
#define WBC_CHECKS_H

#include "safety.h"

enum { WBC_PAST = 64 }; /* readings in the window, at most */

typedef struct {
    int64_t sequence;
    wbc_reading past[WBC_PAST]; /* ring buffer: accepted ones of the last window */
    int first, count;
    double velocities[WBC_JOINTS], spins[3]; /* their sums */
    int knows_offset, strangers;
    double offset, strange[WBC_CLOCK_AGREEMENT]; /* of the robot's clock from ours, by the freshest readings */
    double last_offset;
    double jumped_back; /* sum of the clock's jumps [s], added to times */
    double changed[2];  /* when gyroscope and accelerometer last changed */
    double gravity[3];  /* mean specific force, world axes */
    double weighed;     /* when its size was last plausible */
} wbc_checks;

void wbc_checks_start(wbc_checks *c);
/* Return the fault for which a reading, taken from the bus at now, is rejected; -1: accepted. Its time is corrected
 * for jumps of the robot's clock. */
int wbc_checks_refused(wbc_checks *c, wbc_reading *reading, double now);
/* Report sensors that contradict each other or are frozen, by an accepted reading. commanded: expected motor
 * torques; 0: unknown. */
void wbc_checks_compared(wbc_checks *c, const wbc_reading *reading, const double *commanded, wbc_safety *s);

#endif
