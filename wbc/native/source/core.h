/* The native core: arithmetic of one control tick on memory that the caller owns.
 *
 * No global, no allocation, no Python: every function reads and writes only what its arguments
 * point at, so that threads with memory of their own need no lock. Matrices are row-major; spatial
 * vectors linear first; rotations take local axes to the world's. The layouts below are told to
 * Python by wbc/native/library.py and wbc/robot/kernel.py, which must agree.
 */
#ifndef WBC_CORE_H
#define WBC_CORE_H

#include <math.h>
#include <stdint.h>

/* Raised with every change of a layout or a meaning: what is loaded must say the same. */
#define WBC_CORE_VERSION 1

enum joint_kind { FREE_FLYER = 0, REVOLUTE = 1, PRISMATIC = 2, CONTINUOUS = 3 };

/* A kinematic tree: joint 0 is the world, joint 1 the free-flyer; parents come before children. */
typedef struct {
    int64_t nv, joints;
    const int64_t *parent, *kind, *iq, *iv; /* (joints) */
    const double *placement;                /* (joints, 12) in the parent joint: rotation, origin */
    const double *axis;                     /* (joints, 3) in the joint's own axes */
    const double *body; /* (joints, 10): mass, CoM, inertia xx xy xz yy yz zz about the CoM */
} wbc_tree;

/* What is known of a robot at one state, in fixed places of one array. */
enum { COM = 0, INERTIA = 3, MOMENTUM = 12, CENTROIDAL_MAP = 18 };
#define COM_JACOBIAN(nv) (CENTROIDAL_MAP + 6 * (nv))     /* (3, nv) */
#define INERTIA_JACOBIAN(nv) (CENTROIDAL_MAP + 9 * (nv)) /* (6, nv), rows xx xy xz yy yz zz */
#define TWISTS(nv) (CENTROIDAL_MAP + 15 * (nv))          /* (6, nv), at the world's origin */
#define ROTATIONS(nv) (CENTROIDAL_MAP + 21 * (nv))       /* (joints, 3, 3) */
#define ORIGINS(nv, joints) (ROTATIONS(nv) + 9 * (joints))
#define FRAMES(nv, joints) (ROTATIONS(nv) + 12 * (joints))
/* A frame: origin (3), rotation (3, 3), Jacobian (6, nv) of its origin in world axes. */
enum { FRAME_ROTATION = 3, FRAME_JACOBIAN = 12 };
#define FRAME_SIZE(nv) (FRAME_JACOBIAN + 6 * (nv))

int wbc_core_version(void);

/* Write all that is known at (q, v) into state, and behind it some frames, given by their joints
 * and their placements (12 each) there. scratch holds 13 numbers a joint. Returns 0. */
int wbc_state(const wbc_tree *tree, const double *q, const double *v, double *state,
              double *scratch, int64_t frames, const int64_t *joint, const double *placement);
/* Write frames, one behind the other, as they are in a state. Returns 0. */
int wbc_frames(const wbc_tree *tree, const double *state, int64_t count, const int64_t *joint,
               const double *placement, double *out);

#endif
