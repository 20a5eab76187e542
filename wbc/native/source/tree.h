/* Where the joints of a tree are. */
#ifndef WBC_TREE_H
#define WBC_TREE_H

#include "core.h"

/* Not of the library's interface. */
#pragma GCC visibility push(hidden)

/* Write rotations and origins of all joints at q into a state; arms holds 3 numbers a joint. */
void place_joints(const wbc_tree *tree, const double *q, double *state, double *arms);

#pragma GCC visibility pop

#endif
