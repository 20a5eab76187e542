/* Where an estimator remembers what, and its parts. */
#ifndef WBC_ESTIMATOR_H
#define WBC_ESTIMATOR_H

#include "core.h"

typedef struct {
    double *time, *lost_since, *usual;     /* of messages: the last, and how far apart they are */
    double *times, *positions, *believed;  /* (window), (window, n), (n) of joints */
    double *heard, *last;                  /* (imus), (imus, 6) */
    double *since, *moves, *pace, *apart;  /* (feet), the last (feet, feet) */
    int64_t *counts;
    int64_t *stands, *slips, *bears, *strikes; /* (feet) */
    int64_t *has, *same;                       /* (imus) */
    int64_t *distrusted;                       /* (n) */
} wbc_memory;

/* What moves the filter over one period. */
typedef struct {
    double rate[3], force[3], scale;
} wbc_inertial;

/* Rows of messages that are kept in the beginning. */
#define WAIT_SIZE(n, imus, feet) (4 + 3 * (n) + 7 * (imus) + (feet))
#define HAS(set, k) ((set) >> (k) & 1)

wbc_memory wbc_remembered(const wbc_estimator *e);
void wbc_note(const wbc_estimator *e, int64_t kind, int64_t whose, double how_much);
/* Which IMU is used, and what it says: members of one link as one in their middle. Returns DONE or NO_IMU. */
int wbc_hear(const wbc_estimator *e, const wbc_memory *m, const wbc_sample *s, wbc_inertial *found);
/* IMUs on the link of the leader. */
int64_t wbc_companions(const wbc_estimator *e, int64_t leader);
/* Mean over members of what they say, (imus, 6), in the axes of the leader. */
void wbc_fused(const wbc_estimator *e, int64_t leader, int64_t members, const double *said, double *out);
/* Write positions to believe (n), and their rates. */
void wbc_believe(const wbc_estimator *e, const wbc_memory *m, const wbc_sample *s, double dt, double *positions,
                 double *rates);
/* Place all frames at joint positions (n), and behind them the IMU that is used. */
void wbc_look(const wbc_estimator *e, const wbc_memory *m, const double *positions);
/* Hold, correct by or release each foot; write the innovation. Returns DONE or NOT_FINITE. */
int wbc_see_feet(const wbc_estimator *e, const wbc_memory *m, const wbc_sample *s, const double *rate,
                 const double *rates, int standing, double *squared);
/* Count on no foot any more: nobody knows where they stepped. */
void wbc_let_go(const wbc_estimator *e, const wbc_memory *m);
/* Begin the filter of a robot at rest that feels this force, and turns so: biases. DONE or NO_GRAVITY. */
int wbc_level(const wbc_estimator *e, const double *rate, const double *force);

#endif
