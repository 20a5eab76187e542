/* The memory of an estimator, and the parts of an update. */
#ifndef WBC_ESTIMATOR_H
#define WBC_ESTIMATOR_H

#include "core.h"

typedef struct {
    double *time, *lost_since, *usual;    /* of messages: time of the last one, and the usual interval */
    double *times, *positions, *believed; /* (window), (window, n), (n) of joints */
    double *heard, *last;                 /* (imus), (imus, 6) */
    double *held;                         /* (7) since the last reading: time, integrals of rate and force held */
    double *since, *moves, *pace, *apart; /* (feet), the last (feet, feet) */
    int64_t *counts;
    int64_t *stands, *slips, *bears, *strikes; /* (feet) */
    int64_t *has, *same;                       /* (imus) */
    int64_t *distrusted;                       /* (n) */
} wbc_memory;

/* The filter's input over one period: the reading in use, what to predict by, and its variance by a reading's. */
typedef struct {
    double rate[3], force[3], mean[6], scale;
} wbc_inertial;

/* Size of one message stored before the estimate begins. */
#define WAIT_SIZE(n, imus, feet) (4 + 3 * (n) + 7 * (imus) + (feet))
#define HAS(set, k) ((set) >> (k) & 1)

wbc_memory wbc_memory_of(const wbc_estimator *e);
void wbc_report(const wbc_estimator *e, int64_t kind, int64_t whose, double how_much);
/* Choose the IMU, and write its reading: the mean of those on one link, at their centre. Returns DONE or NO_IMU. */
int wbc_read_imus(const wbc_estimator *e, const wbc_memory *m, const wbc_sample *s, wbc_inertial *found);
/* The IMUs on the link of the leader. */
int64_t wbc_imus_on_link(const wbc_estimator *e, int64_t leader);
/* Mean of the members' readings (imus, 6), in the axes of the leader. */
void wbc_mean_of_imus(const wbc_estimator *e, int64_t leader, int64_t members, const double *readings, double *out);
/* From one position of a joint of the tree to another: the short way where it turns on and on. */
double wbc_joint_motion(const wbc_estimator *e, int64_t joint, double from, double to);
/* Write joint positions (n) without jumps, and their rates. */
void wbc_read_joints(const wbc_estimator *e, const wbc_memory *m, const wbc_sample *s, double dt, double *positions,
                     double *rates);
/* Place all frames at joint positions (n), and behind them the IMU in use. */
void wbc_place_frames(const wbc_estimator *e, const wbc_memory *m, const double *positions);
/* Hold, correct by or release each foot; write the innovation. Returns DONE or NOT_FINITE. */
int wbc_update_feet(const wbc_estimator *e, const wbc_memory *m, const wbc_sample *s, const double *rate,
                    const double *rates, int standing, double *squared);
/* Release all feet: they may have stepped. */
void wbc_release_feet(const wbc_estimator *e, const wbc_memory *m);
/* Initialise the filter of a robot at rest, by its specific force and angular velocity (the gyroscope's bias).
 * Returns DONE or NO_GRAVITY. */
int wbc_align_to_gravity(const wbc_estimator *e, const double *rate, const double *force);

#endif
