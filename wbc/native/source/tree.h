/* Where the joints of a tree are. */
#ifndef WBC_TREE_H
#define WBC_TREE_H

#include "core.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* Whether numbers are what may be entries of q and v: finite, and within what rounding allows. */
int is_measured(const double *values, int64_t n);

/* How many numbers a configuration has. */
int64_t configuration_size(const wbc_tree *tree);
/* v, or where it lies behind q if v is 0. */
const double *velocity_of(const wbc_tree *tree, const double *q, const double *v);

/* Write rotation and origin (12) of a joint in its parent, once it has moved from q by v dt. */
void moved_joint(const wbc_tree *tree, int64_t j, const double *q, const double *v, double dt,
                 double *pose);

/* Write rotations and origins of all joints at q into a state; arms holds 3 numbers a joint. */
void place_joints(const wbc_tree *tree, const double *q, double *state, double *arms);

#pragma GCC visibility pop

#endif
