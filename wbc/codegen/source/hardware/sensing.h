/* Estimate of the base's state from IMU, encoders and motor torques.
 *
 *     static wbc_sensing s;
 *     wbc_sensing_start(&s);
 *     every message: if (wbc_sensing_take(&s, &sample, out) == DONE)
 *         ... out + WBC_AT_Q, out + WBC_AT_V        (core.h: what else an estimate has)
 *
 * It returns STANDING until the robot has stood still for half a second. A message not later than the last one is
 * dropped (LATE_MESSAGE); Python inserts it at its time.
 */
#ifndef WBC_SENSING_H
#define WBC_SENSING_H

#include "data.h"

/* It contains pointers into itself: do not move or copy it after the start. */
typedef struct {
    wbc_estimator estimator;
    wbc_filter filter;
    wbc_momentum momentum;
    double last;
    int64_t held[WBC_FEET], counts[WBC_COUNTS], event[WBC_EVENT];
    double filter_x[WBC_FILTER_X], P[WBC_FILTER_P], filter_scratch[WBC_FILTER_SCRATCH], origin[3];
    double x[WBC_X], detail[WBC_DETAIL], wait[WBC_WAIT], frames[WBC_FRAMES], state[WBC_EST_STATE];
    double scratch[WBC_EST_SCRATCH];
    double residual[WBC_JOINTS + 6], velocity[WBC_JOINTS + 6], motion[WBC_MOTION], wrenches[6 * WBC_FEET];
    double momentum_state[WBC_EST_STATE], momentum_frames[WBC_MOMENTUM_FRAMES];
    double momentum_scratch[WBC_MOMENTUM_SCRATCH], known[1];
} wbc_sensing;

enum { LATE_MESSAGE = 30 };

/* Initialise; the robot has to stand still on its feet. */
void wbc_sensing_start(wbc_sensing *s);
/* Process a message; write the estimate. Other than DONE: there is none. */
int wbc_sensing_take(wbc_sensing *s, const wbc_sample *sample, double out[WBC_ESTIMATE]);

#endif
