/* The native core: arithmetic of one control tick on memory that the caller owns.
 *
 * No globals, no allocation, no Python: every function reads and writes only what its arguments point at, so that
 * threads with memory of their own need no lock. Matrices are row-major; spatial vectors linear first; rotations
 * take local axes to the world's. cffi also reads this file for Python, but for the preprocessor's lines:
 * constants that Python needs are enums.
 */
#ifndef WBC_CORE_H
#define WBC_CORE_H

#include <math.h>
#include <stdint.h>

enum joint_kind { FREE_FLYER = 0, REVOLUTE = 1, PRISMATIC = 2, CONTINUOUS = 3 };

/* A kinematic tree: joint 0 is the world, joint 1 the free-flyer; parents come before children. */
typedef struct {
    int64_t nv, joints;
    const int64_t *parent, *kind, *iq, *iv; /* (joints) */
    const double *placement;                /* (joints, 12) in the parent joint: rotation, origin */
    const double *axis;                     /* (joints, 3) in the joint's own axes */
    const double *body;                     /* (joints, 10): mass, CoM, inertia xx xy xz yy yz zz about the CoM */
    const double *armature;                 /* (nv) rotor inertia */
    const double *gravity;                  /* (3) */
} wbc_tree;

/* Tolerance of a measured quaternion's norm, what normalisation leaves of it, and the largest entry of a state; the
 * largest entry of a QP, whose square does not overflow. */
extern const double wbc_unit, wbc_unit_rounding, wbc_largest_state, wbc_largest_qp;

/* The kinematics at one state, at fixed places of one array. */
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

/* Write the kinematics at (q, v) to state, and behind them frames, given by their joints and placements (12 each).
 * scratch holds 13 numbers a joint and 17 a column of v. Returns 0. */
int wbc_state(const wbc_tree *tree, const double *q, const double *v, double *state, double *scratch, int64_t frames,
              const int64_t *joint, const double *placement);
/* Write n states, one behind the other, each with its frames; change: 0, or the momentum Jacobians (n, 6, nv).
 * Returns 0. */
int wbc_states(const wbc_tree *tree, int64_t n, const double *q, const double *v, double *states, double *scratch,
               int64_t frames, const int64_t *joint, const double *placement, double *change);
/* Write frames, one behind the other, as in a state. Returns 0. */
int wbc_frames(const wbc_tree *tree, const double *state, int64_t count, const int64_t *joint,
               const double *placement, double *out);
/* Write origins and rotations of frames (12 each). Returns 0. */
int wbc_frame_poses(const wbc_tree *tree, const double *state, int64_t count, const int64_t *joint,
                    const double *placement, double *out);
/* Write the second derivative (nv, nv) of <G, I> by v, with G and I (about the CoM) as xx xy xz yy yz zz, world
 * axes. work holds 13 (nv + 3) numbers. Returns 0. */
int wbc_inertia_hessian(const wbc_tree *tree, const double *state, double mass, const double *G, double *work,
                        double *H);
/* Write the rotation vectors (n, 3) of rotations (n, 3, 3), at most half a turn. Returns 0. */
int wbc_logarithms(int64_t n, const double *R, double *r);
/* Write q integrated over a displacement (nv), as Pinocchio does. Returns 0. */
int wbc_integrate(const wbc_tree *tree, const double *q, const double *step, double *out);
/* Write a measured state, q then v (nq + nv), its unit vectors normalised if they are but for rounding. Returns
 * DONE, or NOT_FINITE if it is no state: Python says where and why. Here and for ticks Python passes buffers of
 * doubles as void pointers. */
int wbc_check(const wbc_tree *tree, const void *q, const void *v, double *out);
/* The same with v dt in place of v, and behind it q integrated over that (nq). */
int wbc_move(const wbc_tree *tree, const double *q, const double *v, double dt, double *out);
/* Write n configurations (n, nq), each integrated over its own displacement (n, nv); scratch holds 2 nq + nv numbers.
 * Returns how many are right: n, or the number of the first for which wbc_move returns NOT_FINITE. */
int64_t wbc_moves(const wbc_tree *tree, int64_t n, const double *q, const double *step, double *scratch, double *out);

/* Write the derivative (6, nv) of the momentum by the configuration at constant v; scratch is as wbc_state left it. A
 * joint with twist S (about the CoM), on a body with twist V, moves its subtree of momentum L and inertia Y as one:
 *
 *     dh = S x* L + Y (V x S), minus the CoM's displacement x the linear momentum     (Featherstone 2008, ch. 2)
 *
 * Returns 0. */
int wbc_momentum_jacobian(const wbc_tree *tree, const double *state, const double *v, double *scratch, double *out);

/* Dynamics at a velocity v: mass matrix (nv, nv), bias forces (nv); at zero acceleration of v the accelerations of
 * CoM and momentum; first and second derivative of the inertia, world axes; the motion of each joint's origin and
 * axes. */
#define BIAS(nv) ((nv) * (nv))
#define DRIFTS(nv) (BIAS(nv) + (nv))
enum { COM_DRIFT = 0, MOMENTUM_DRIFT = 3, INERTIA_RATE = 9, INERTIA_CURVATURE = 15, DRIFTS_SIZE = 21 };
#define JOINT_MOTION(nv) (DRIFTS(nv) + DRIFTS_SIZE) /* (joints, 9) */
enum { OMEGA = 0, ALPHA = 3, ACCELERATION = 6, JOINT_MOTION_SIZE = 9 };
#define MOTION_SIZE(nv, joints) (JOINT_MOTION(nv) + JOINT_MOTION_SIZE * (joints))

/* Where the parts begin in a state and in a motion, in order; frames and end: where the rest begins. */
typedef struct {
    int64_t com, inertia, momentum, centroidal_map, com_jacobian, inertia_jacobian, twists, rotations;
    int64_t origins, frames;
} wbc_state_places;
typedef struct {
    int64_t mass_matrix, bias, com_drift, momentum_drift, inertia_rate, inertia_curvature, joints, end;
} wbc_motion_places;
int wbc_places(const wbc_tree *tree, wbc_state_places *state, wbc_motion_places *motion);

/* Write that to motion; scratch holds 9 numbers a joint and 6 a column. Returns 0. */
int wbc_motion(const wbc_tree *tree, const double *state, const double *v, double *motion, double *scratch);
/* Write the accelerations (6) of frames at zero acceleration of v. Returns 0. */
int wbc_drifts(const wbc_tree *tree, const double *state, const double *motion, int64_t count, const int64_t *joint,
               const double *placement, double *out);

/* Convex bodies on joints (rounded hulls of corners, each with a bounding capsule, which is a rounded hull of two
 * corners or one; half-spaces on joint 0), and the pairs to keep apart. */
enum { CAPSULES = 0, HULLS = 1, ABOVE = 2 }; /* HULLS: at least one of the two; ABOVE: the second is a half-space */
typedef struct {
    int64_t nv, joints, bodies, pairs;
    const int64_t *joint;   /* (bodies) */
    const double *local;    /* (bodies, 3, 3) columns: start, unit direction, centre; joint's axes. Of a half-space:
                            * a point of its surface, its normal, the point */
    const double *size;     /* (bodies, 3): length, radius, radius of a ball about the centre */
    const int64_t *pair;    /* (pairs, 2) */
    const int64_t *kind;    /* (pairs) */
    const int64_t *common;  /* (pairs): the last joint that moves both */
    const int64_t *first;   /* (bodies + 1): where a body's corners begin */
    const double *corner;   /* (3, corners) of all, joint's axes */
    const double *rounding; /* (bodies): radius round the hull of the corners */
    const double *shorter;  /* (pairs): length of the shorter body without its radius */
} wbc_pairs;

/* Write the numbers (ascending) of the count pairs of least distance, minus kept (pairs) unless 0; and of each (7,
 * count) distance, normal towards the first body, nearest point on the first. Distance -INFINITY: hulls overlap, by
 * a depth unknown here. Returns 0; -1: count pairs overlap, or the state is not finite. scratch holds 10 numbers a
 * body and 10 a pair. */
int wbc_nearest(const wbc_pairs *of, const double *state, int64_t count, const double *kept, double *scratch,
                int64_t *chosen, double *nearest);
/* Write (7, k) of k given pairs, as wbc_nearest does. Returns 0. */
int wbc_measure(const wbc_pairs *of, const double *state, int64_t k, const int64_t *chosen, double *scratch,
                double *nearest);
/* Write frame and pair (k, 2), and (7) of each as above, of all pairs of n states (stride apart) whose distance is
 * less than kept + limit; -INFINITY for overlapping hulls. Returns k, of which at most room are written; -1: a
 * state is not finite. */
int64_t wbc_pairs_within(const wbc_pairs *of, const double *states, int64_t n, int64_t stride, double limit,
                         const double *kept, double *scratch, int64_t room, int64_t *chosen, double *nearest);
/* The motion with which bodies close, and their braking: wbc/robot/collision/native_pairs.py. */
typedef struct {
    const double *twist;    /* (k, 6): linear part at the world's origin, then angular */
    const int64_t *carrier; /* (bodies): which of these twists moves each body */
    double dt, slowest;
    double least; /* dt / gain */
    double half;  /* 0.5 / deceleration */
} wbc_closing;
/* As wbc_nearest, of least distance minus kept and the stopping distance; left (count): the differences. Returns 1,
 * too: more than count may not stop in time. */
int wbc_most_urgent_pairs(const wbc_pairs *of, const double *state, int64_t count, const double *kept,
                          const wbc_closing *closing, double *scratch, int64_t *chosen, double *nearest,
                          double *left);
/* Write the derivatives (k, nv) of distances by v; normals and points (3, k). Returns 0. */
int wbc_pair_rows(const wbc_pairs *of, const wbc_tree *tree, const double *state, int64_t k, const int64_t *chosen,
                  const double *normal, const double *point, double *rows);
/* The same of pairs as wbc_pairs_within writes them. */
int wbc_rows_within(const wbc_pairs *of, const wbc_tree *tree, const double *states, int64_t stride, int64_t k,
                    const int64_t *chosen, const double *nearest, double *rows);
/* Write bounds (k) of how far distances end below their linear prediction over a step (nv). turns: scratch, a
 * number a joint. Returns 0. */
int wbc_curvature_bounds(const wbc_pairs *of, const wbc_tree *tree, const double *step, int64_t k,
                         const int64_t *chosen, double *turns, double *bounds);

/* A margin between those pairs: wbc/constraints/margin.py and collision.py. */
typedef struct {
    const wbc_pairs *of;
    const double *kept;         /* (pairs): distance, skin included */
    const double *acceleration; /* (nv - 6) of joints, for braking; or 0 */
    int64_t rows;               /* pairs with a row, those of least clearance: see most_urgent_pairs */
    double deceleration, gain, recovery, recovery_speed;
} wbc_margin;

/* Constants of margins, here and in Python; explained in source/margin.c. */
extern const double wbc_skin, wbc_skin_per_tick, wbc_rounding, wbc_interior_speed, wbc_interior_share, wbc_lever,
    wbc_margin_braking, wbc_margin_leaving;
/* Write the least rates of clearances (k) with rows (k, nv) by the margin's braking law: negative, or positive if
 * they have to grow. dt: of a tick. Returns 0. */
int wbc_approach(const wbc_margin *margin, int64_t nv, double dt, int64_t k, const double *rows,
                 const double *clearance, double *least);

/* Kinds of rows; wbc/native/rows.py describes them. */
enum row_kind {
    POINT = 0,
    ORIENTATION = 1,
    INERTIA_ENTRIES = 2,
    JOINTS = 3,
    MOMENTUM_ENTRIES = 4,
    CONTACT = 5,
    LINEAR = 6,
    GIVEN = 7,
    LOOP = 8,
    GEAR = 9,
    ASKED = 10,
    COP = 11,
    POINTING = 12,
    RELATIVE = 13
};
/* A block of rows: its kind, its place among the costs or the contacts (held), where its selection begins in index
 * and its numbers in number, its frame (-1: the CoM, or the world), its level among the costs, and whether its
 * neglected curvature is in the cost (second: of INERTIA_ENTRIES, ASKED) or damped. other: the frame that holds a
 * LOOP, in which a RELATIVE is seen, or the place of a COP's rows in moments. */
typedef struct {
    int64_t kind, held, rows, first, frame, index, number, level, second, other;
} wbc_block;
/* Numbers of a block: of its law; weights (rows); biases (rows); the part of the drifts by the target's motion
 * (rows); then those of its kind. ASKED rows come from a task in Python: their whole drifts in place of that part,
 * Jacobian (rows, nv), error (rows), a bound of the curvature (nv) and, if second, the curvature (nv, nv). GIVEN
 * rows, on forces: matrix (rows, n), target (rows). COP rows are the horizontal moment of all contact forces about
 * a point (3), or of one frame's contact, in its axes; then whether the point is at the contacts' mean height. The
 * errors of both are those of the solution [N, N m]. */
enum { RATE = 0, HALF_GAIN = 1, LM_DAMPING = 2, STIFFNESS = 0, DAMPING = 1, WEIGHTS = 3 };

/* Unknown forces of a contact: at corners, or (corners 0) one along each of its rows. */
typedef struct {
    int64_t block;   /* the contact's */
    int64_t column;  /* its first force, among the forces */
    int64_t corners; /* three forces each */
    int64_t corner;  /* where they begin among the corners' coordinates (3 each), frame's axes */
    int64_t count;   /* rows */
    int64_t aligned; /* forces in the world's axes rather than the frame's */
} wbc_force;

/* The plan of a tick: levels of costs, contacts as equalities, a box, inequality rows. Made once; its numbers
 * follow the tasks. The unknowns are v+ (nv) and, at the torque level, contact forces. */
typedef struct {
    const wbc_tree *tree;
    const wbc_block *block;
    const int64_t *index;
    const double *number;
    const int64_t *frame_joint;    /* (frames); the first is the base; behind them, ends of loops */
    const double *frame_placement; /* (12) of each */
    const int64_t *start;          /* (nv - 6): where a joint's coordinate is in q */
    const double *damping;         /* (nv + forces) */
    const double *limit; /* (5, nv - 6): lower, upper, speed, acceleration and deceleration; (2, 6): of the base */
    const wbc_force *force;
    const double *corner;
    const int64_t *passive;      /* (passives): entries of v without a motor */
    const int64_t *with_bound;   /* (bounded): entries of v with a torque bound */
    const double *torque_bound;  /* (bounded), in units of the forces, as all that follows */
    const double *cone;          /* (cones, forces), lower (cones), upper (cones) */
    const double *force_bound;   /* (2, forces): lower, upper */
    const double *joint_damping; /* (nv - 6) [N m s/rad] */
    const double *load;          /* (nv) forces without a command: of springs [N, N m] */
    const double *given; /* inequality rows on v+ given by Python: matrix (given_rows, nv), lower, upper, compliance
                          * (given_rows) */
    const double *push;  /* costs that outweigh all others, of rows being recovered: matrix (pushes, nv), target,
                          * weight (pushes) */
    const double *added; /* (held) added to the errors of loops and gears: gaps that a tick is not to take back */
    double *rows;    /* of all costs: matrix (costs, n), target (costs), bias (costs); of each level its damping (nv)
                   * and, if curved, the neglected curvature (nv, nv). 0 for one level that nobody reads. */
    double *moments; /* (COP rows, forces) */
    double *below;   /* the QP of the last level below the first: source/levels.c */
    double *state;   /* for the kinematics, if the caller has none */
    double *out;
    double *scratch;
    int64_t *order;           /* integers of wbc_sizes; the pivots' columns (k); (pairs) of a margin */
    const wbc_margin *margin; /* rows behind all others, or 0 */
    int64_t blocks, frames, costs, held, limited;
    int64_t torque, forces, bearing, passives, bounded, cones, wide; /* wide: see wbc_qp */
    int64_t levels, curved, given_rows, soft, pushes;                /* soft: whether given rows have a compliance */
    int64_t braked;      /* whether the acceleration limit bounds deceleration, too */
    int64_t outside;     /* whether an external solver answers the reduced QP */
    int64_t always;      /* whether a solver is asked even where the unconstrained optimum is feasible */
    int64_t most;        /* largest number of iterations of the active-set method */
    int64_t solver_end;  /* where the solver's part of scratch ends */
    int64_t last_pivots; /* where the pivots' columns of the last tick begin in order: see wbc_sizes */
    int64_t closing;     /* whether loops and gears are closed where the command leads: source/loop_closure.c */
    double dt, mass, unit, eps; /* unit: newtons per unit of a force; eps: as in wbc_qp */
    double recovery;            /* part of a joint limit's violation that is recovered in a tick */
} wbc_plan;

/* minimise 1/2 x'P x + g'x subject to A x = b, l <= C x <= u, lower <= x <= upper; n unknowns, k equalities, m
 * rows. Of a plan, also: D, offset: base forces and torques D x + offset, at the torque level; errors of the costs,
 * and the largest square of a weighted row. */
typedef struct {
    int64_t n, k, m, wide; /* beyond wide P is diagonal */
    double eps;            /* largest accepted residual */
    double *P, *A, *C, *g, *lower, *upper, *b, *l, *u;
    double *x, *y, *z, *z_box, *found; /* the solution; residuals (3), iterations, levels solved */
    double *D, *offset, *errors, *heaviest;
    double *exact, *torque;     /* (nv), (nv - 6): see command in source/levels.c */
    double *clearance, *chosen; /* of the margin's rows, and numbers of their pairs */
} wbc_qp;

/* Outcomes of a tick. UNSOLVED: no solution was found; INFEASIBLE: y, z and z_box are a certificate, see
 * wbc_solve_qp. NOT_MEASURED: a pair's distance is unknown; LEADS_INSIDE: the solution leads into a margin, or to
 * an unknown distance. MORE_ROWS: more pairs may not stop in time than the plan has rows. REDUCED: an external
 * solver has to answer. */
enum status {
    INFEASIBLE = -2,
    UNSOLVED = -1,
    DONE = 0,
    NOT_FINITE = 3,
    NOT_MEASURED = 4,
    LEADS_INSIDE = 5,
    MORE_ROWS = 6,
    REDUCED = 7,
    OUTLIER = 8
};
/* Write the QP of the first level. state: plan->state with what wbc_state wrote at (q, v), without frames; 0:
 * compute it here. Here and below v may be 0 if it lies behind q. */
int wbc_problem(const wbc_plan *plan, const double *state, const void *measured, const double *v);
/* The same, and the solutions of all levels: x, y, z, z_box of each QP; primal, dual and complementarity residual,
 * iterations, and in the first one how many levels were solved. Equalities are eliminated; a feasible unconstrained
 * optimum is the solution, in 0 iterations. Else the active-set method solves the reduced QP; or REDUCED is
 * returned, with its number of rows as the first residual. */
int wbc_tick(const wbc_plan *plan, const double *state, const void *measured, const double *v);
/* Write P (n, n) and g (n) of one level's costs and damping, or of all levels together (-1). */
int wbc_cost(const wbc_plan *plan, const double *q, const double *v, int64_t level, double *P, double *g);
/* The steps of a tick, for callers that change the QPs (g, say) before they are solved: write the QP of a level
 * below the first from the solution of the level above; solve a level; write the command of the last level solved
 * (wbc_finish). */
int wbc_pose(const wbc_plan *plan, const double *q, const double *v, int64_t level);
int wbc_solve(const wbc_plan *plan, int64_t level);
int wbc_finish(const wbc_plan *plan, const double *q, const double *v);
/* Solve the levels below the first, whose solution the caller wrote, and write the command. */
int wbc_descend(const wbc_plan *plan, const double *q, const double *v);
/* Outside ticks: write Jacobian (held, nv), errors (held), biases (held), drifts (held) and a bound of the
 * neglected curvature (1) of the blocks of a plan, all of them held. motion: as wbc_motion wrote it; 0: no drifts.
 * scratch holds the plan's frames, and 6 numbers of each. Returns 0. */
int wbc_rows(const wbc_plan *plan, const double *state, const double *motion, const double *q, const double *v,
             double *out);
/* Outside ticks: write the box on v+ (2, nv), lower then upper bounds. Returns 0. */
int wbc_box(const wbc_plan *plan, const double *q, const double *v, double *box);
/* Gaps of loops and gears that count as open, and that steps close; source/loop_closure.c. */
extern const double wbc_closed, wbc_far_open;
enum { CLOSING_ROUNDS = 5 }; /* each reduces a gap by a factor of the joints' motion in a tick [rad] */
/* Write the gaps of loops and gears (held) where v leads in dt from a state at q, 0 for linear rows. Returns 0. */
int wbc_gaps(const wbc_plan *plan, const double *state, const double *q, const double *v, double *gaps);
/* Write where the reduced QP begins in scratch: P (left, left), g, lower and upper bounds (left + rows) of x and
 * then of C x, C (rows, left); and left. Returns 0. */
int wbc_reduced(const wbc_plan *plan, int64_t *begin);
/* After REDUCED: write the first level's solution from the reduced one, x (left) and multipliers of rows, then of
 * bounds, times scale; x 0: by the active-set method. Then call wbc_descend. */
int wbc_answer(const wbc_plan *plan, const double *x, const double *z, double scale, int64_t iterations);
/* Write how many numbers and integers solving a QP takes, of n unknowns, k equalities and m rows, and where in the
 * integers those that last begin. */
int wbc_sizes(int64_t n, int64_t k, int64_t m, int64_t *sizes);
/* Write where a level's QP lies: n, k, m; places in out (or, of levels below the first, in below) of P A C g lower
 * upper b l u x y z z_box found D offset errors heaviest exact torque clearance chosen begin; then the sizes of out
 * and below. */
enum { LAYOUT = 27 };
int wbc_layout(const wbc_plan *plan, int64_t level, int64_t *at);
/* Solve any QP by the active-set method, in at most most iterations. compliance (m), or 0: rows are l <= C x - s <=
 * u at the cost 1/2 s^2 / compliance, s = 0 where it is 0. INFEASIBLE: y, z, z_box are a Farkas certificate: y'A +
 * z'C + z_box' = 0, and their sum with the bounds they point at is below 0. */
int wbc_solve_qp(const wbc_qp *qp, const double *compliance, int64_t most, double *scratch, int64_t *order);

/* The next footstep, in the stance foot's axes [m, s]; named as wbc/gait/adaptation.py does. */
typedef struct {
    double dcm[2], place[2], left, offset[2], vrp[2]; /* as measured; the nominal plan, and then the plan */
    double lower[2], upper[2], min_time, max_time, sole[2];
    double foot[2], rate[2], acceleration, about; /* of the reach */
    double omega, double_support, gain, weights[4];
    /* its QP, as of a wbc_qp, and the solution */
    double P[49], A[14], C[56], g[7], low[7], high[7], b[2], l[8], u[8], x[7], y[2], found[4];
    double multipliers[15]; /* of the rows C, and then of the bounds */
} wbc_footstep;
/* Plan it, by a QP whose numbers are all 0 before, in at most most iterations. Returns DONE; else the nominal plan is
 * left as it was, min_time and max_time are what the foot can do, and the QP is there to be solved otherwise. */
int wbc_solve_footstep(wbc_footstep *s, double eps, int64_t most);
/* Make the plan what x says, or, if that does not solve the QP, the nominal one within its bounds. Returns DONE. */
int wbc_place_footstep(wbc_footstep *s, int solved);

/* A foot in the air (source/swing.c): x, y [m], yaw [rad] and the horizontal part of the sole's unit normal, and
 * their rates and accelerations; its height, likewise [m]; the part of its path that is done; the rate of that by
 * the nominal one; and the time since the planned touch-down [s]. */
typedef struct {
    double level[3][5], height[3], done, pace, late;
} wbc_swing_foot;
/* Its path: the height at lift-off [m], the horizontal part of the normal where it lands, how high it is lifted in
 * the usual time [m, s], the speed at which it goes on down when late [m/s]. Over edges, if it crosses any: its height
 * half way [m], the parts of the time at both ends without horizontal motion, the largest pitch, toe down [rad]. */
typedef struct {
    double start, normal[2], clearance, usual, descent, crosses, top, begins, ends, tip;
} wbc_swing_path;
/* A late foot's acceleration up to that speed [m/s^2], and the part of the time at which the pitch is largest. */
extern const double wbc_speed_up, wbc_pitch_peak;
/* Write the foot dt later, and its pose (24): position, rotation, twist and the twist's derivative. It lands
 * at x, y, yaw on ground of that height [m] after left [s]; most is the largest acceleration of a foot that stops
 * before it passes its goal [m/s^2]. Returns 0. */
int wbc_swing(const wbc_swing_path *path, double x, double y, double yaw, double ground, double left, double dt,
              double most, const wbc_swing_foot *before, wbc_swing_foot *foot, double *pose);
/* Write motions (3, n), values, rates and accelerations, dt later on the curves of least jerk that end at rest at the
 * goals (n) after left [s]; out may be now. Returns 0. */
int wbc_towards(int64_t n, double left, double dt, const double *now, const double *goal, double *out);
/* The shortest time [s] within which a foot comes to rest in a box of corners (2), at an acceleration of at most that on
 * each axis: within T it gets to place + T/2 rate +- rest_range acceleration T^2. */
extern const double wbc_rest_range;
double wbc_rest_time(double most, const double *place, const double *rate, const double *lower, const double *upper);

/* Write primal, dual and complementarity residual of x, y, z, z_box to found (3). gradient (n) is scratch. Returns
 * 0. */
int wbc_residuals(const wbc_qp *qp, double *gradient);

/* Fit a capsule of small volume round points (count, 3): move its ends (2, 3), in steps that begin with size [m],
 * until the search's corners agree to the accuracies [m, m^3], or most steps are made. Its radius is the distance
 * of the farthest point. Returns 0. */
int wbc_fit_capsule(int64_t count, const double *points, double size, int64_t most, double accuracy,
                    double value_accuracy, double *ends);

/* An invariant filter of an IMU and of standing feet (source/filter.c). x: rotation of the IMU, velocity, position,
 * biases of gyroscope and accelerometer, then of each foot position and rotation; world axes, biases in the IMU's.
 * P (n, n), n = 15 + 6 feet: covariance of the errors of rotation, velocity, position, biases, and of each foot's
 * position and rotation; rows of released feet are 0. */
enum { FILTER_V = 9, FILTER_P = 12, FILTER_GYRO = 15, FILTER_ACCEL = 18, FILTER_FEET = 21, FILTER_FOOT_SIZE = 12 };
typedef struct {
    int64_t feet;
    int64_t *held;           /* (feet) whether they stand */
    double *x, *P, *scratch; /* scratch: 7 n */
    double *origin;          /* (3) of positions in x; moves along */
    double gravity[3];
    double gyroscope, accelerometer;           /* noise densities, squared */
    double gyroscope_walk, accelerometer_walk; /* of the biases, squared */
    double creep, roll;                        /* of standing feet, squared */
} wbc_filter;
/* Initialise with rotation, velocity, position and biases (21), all feet released, and the covariance (15, 15) of
 * estimate minus truth (0: zero). Returns 0, as all but wbc_filter_correct. */
int wbc_filter_reset(const wbc_filter *filter, const double *state, const double *covariance);
/* Switch to another IMU of the same body: arm (3) from the old one in world axes, its rotation (3, 3) to the world;
 * its biases (6), their variances, and what is added to the velocity's. Releases all feet. */
int wbc_filter_follow(const wbc_filter *filter, const double *arm, const double *rotation, const double *biases,
                      const double *bias_variances, double velocity_variance);
/* Add to the velocity's variance, for motion that was not measured. */
int wbc_filter_widen(const wbc_filter *filter, double variance);
/* Predict over dt with the IMU's mean rate and specific force (3); scale: of their variance. Returns 0. */
int wbc_filter_predict(const wbc_filter *filter, const double *rate, const double *force, double dt, double scale);
/* Let a foot stand at its place: position (3) and rotation (3, 3) seen from the IMU, noise (6, 6) of it in the
 * IMU's axes. Returns 0. */
int wbc_filter_hold(const wbc_filter *filter, int64_t foot, const double *place, const double *noise);
int wbc_filter_release(const wbc_filter *filter, int64_t foot);
/* Correct by the place of a standing foot: by position (rows 3), or rotation, too (6). innovation: normalised
 * square, then position and rotation (7). DONE, or OUTLIER: beyond the gate, nothing is changed. */
int wbc_filter_correct(const wbc_filter *filter, int64_t foot, const double *place, const double *noise, int64_t rows,
                       double gate, double *innovation);
/* Write the covariance (15, 15) of errors as differences, estimate minus truth, in world axes. Returns 0. */
int wbc_filter_covariance(const wbc_filter *filter, double *out);
/* Write a foot's place seen from the IMU (15): position, rotation, and velocity at joint rates (nv - 6); and its
 * noise (6, 6), from the variance of joint positions and a floor (2) for position and rotation. imu, foot: frames
 * as wbc_frames writes them. Returns 0. */
enum { PLACE_VELOCITY = 12, PLACE_SIZE = 15 };
int wbc_foot_place(int64_t nv, const double *imu, const double *foot, const double *rates, double variance,
                   const double *floor, double *place, double *noise);
/* The speed of such a foot in the world, from the filter's velocity and the IMU's rate (3). */
double wbc_filter_foot_speed(const wbc_filter *filter, const double *rate, const double *place);
/* Write the base's position and quaternion x y z w (7), joints left out, and the velocity (nv), from the filter,
 * the IMU's rate (3) and joint rates (nv - 6). imu: its frame with the base at the origin. Returns 0. */
int wbc_filter_base(const wbc_filter *filter, int64_t nv, const double *imu, const double *rate, const double *rates,
                    double *q, double *v);

/* External forces by residuals of the momentum (source/momentum.c). Kept from call to call: residual (nv), velocity
 * (nv) and motion of the last state, in base axes; wrenches (feet, 6) on the soles, world axes. scratch: the larger
 * of wbc_state's and wbc_motion's. */
enum { MOMENTUM_MOST_FEET = 4 };
typedef struct {
    const wbc_tree *tree;
    int64_t feet;
    const int64_t *joint; /* (feet), and placements there (feet, 12) */
    const double *placement;
    const double *damping, *friction; /* (nv - 6) */
    const double *untied; /* (nv - 6, nv - 6) projector onto joint motions that loops and gears allow, or 0 */
    double base_trust;    /* weight of the base's rows by that of the joints' */
    double bandwidth;     /* forces are seen with a delay of 1 / bandwidth */
    double lever;         /* m^2: regularisation, of levers too short to tell a force */
    double *known;        /* (1) whether there is a last state */
    double *residual, *velocity, *motion, *state, *frames, *wrenches, *scratch;
} wbc_momentum;
/* Update by a state (q, v) and the torques (nv - 6) over the dt before. Returns 0. */
int wbc_momentum_update(const wbc_momentum *momentum, const double *q, const double *v, const double *torque,
                        double dt);

/* State estimation from sensors, message by message (source/estimator.c): IMUs, encoders, and loads of the feet, by
 * sensors or by motor torques. x and counts are its memory, besides filter and momentum; wbc_estimator_sizes says
 * how many. All else that is written is scratch. */
enum { MOST_IMUS = 16 };
typedef struct {
    const wbc_tree *tree;
    const wbc_filter *filter;
    const wbc_momentum *momentum;
    int64_t imus, feet, window, waiting; /* readings of a joint's velocity; messages stored before the beginning */
    const int64_t *joint, *flat; /* (imus + feet) the joints that carry them; (feet) whether they have soles */
    const double *placement;     /* (imus + feet, 12) */
    const double *fastest;       /* (nv - 6) of joints: faster motion is a jump of the reading */
    const double *range;         /* (imus, 2) of rate and force */
    const double *start;         /* (7) base pose to begin at; quaternion 0: none */
    double weight, encoder_variance, encoder_delay, floor[2], bias_variances[2];
    double standing_time, load[2], estimated_load[2], settle, still, slides, sliding, apart, lost, timeout;
    double *x;
    int64_t *counts;
    double *frames, *state, *scratch, *wait, *detail; /* frames: imus, feet, and the IMU in use */
    int64_t *event;
} wbc_estimator;
/* One message. velocities and torques (nv - 6) and loads of the feet, by the weight, may be 0: unknown. */
typedef struct {
    double time;
    const double *positions, *velocities, *torques, *loads;
    const double *imu;    /* (imus, 6) rate, specific force */
    const int64_t *heard; /* (imus) whether the message has its reading */
} wbc_sample;
/* The first counts; then of each foot whether it stands, and whether it slips. */
enum {
    LEADER = 0,
    MEMBERS = 1,
    READINGS = 2,
    BELIEVES = 3,
    FEELS = 4,
    BEGUN = 5,
    WAITS = 6,
    NIS_ROWS = 7,
    FEET_STAND = 8
};
/* An estimate: covariance (15, 15), biases, normalised innovation squared, wrenches on soles (feet, 6), velocity
 * (nv), configuration (nq). */
enum { OUT_GYRO = 225, OUT_ACCEL = 228, OUT_SQUARED = 231, OUT_WRENCHES = 232 };
/* Reported events: their number, then kind and whose (TAKES_OVER: MOST_IMUS times the old one plus the new one);
 * detail: how much. */
enum noted {
    RATE_BEYOND,
    FORCE_BEYOND,
    HANGS,
    TAKES_OVER,
    LEFT_OUT,
    HELD,
    GAP,
    JOINT_JUMPED,
    NO_LOADS,
    COUNTED_ANYWAY,
    SLIPS,
    ROLLS,
    ROLLS_OVER,
    OUTSIDE,
    SLIPPED_OFF,
    FEET_APART
};
/* Why there is no estimate: still standing to begin, no reading of the IMU, gravity is not that of a robot at rest
 * (detail[0]), or NOT_FINITE. */
enum { STANDING = 20, NO_IMU = 21, NO_GRAVITY = 22, NO_ESTIMATE = 23 };
/* Write the sizes of x, counts, wait, event (detail: half of it), out without q, and frames. */
int wbc_estimator_sizes(const wbc_estimator *e, int64_t *sizes);
/* Clear all memory; the robot has to stand to begin. */
int wbc_estimator_reset(const wbc_estimator *e);
/* Process a message later than the last one; write the estimate. */
int wbc_estimator_update(const wbc_estimator *e, const wbc_sample *s, double *out);
/* Add a reading of joints (n) at a time; write the slopes (n) of lines through the last window readings. times
 * (window) and positions (window, n) hold them, count their number. */
int wbc_joint_rates(int64_t window, int64_t n, double *times, double *positions, int64_t *count, double time,
                    const double *reading, double *rates);

/* Add the squares of rows J d + off (count, rows, span nv), the kth on the displacements of frames k to k + span -
 * 1: J'J to a band matrix, column j with its diagonal and what is below it at j height, J'off to slope. Returns 0. */
int wbc_add_normal_equations(int64_t count, int64_t nv, int64_t span, int64_t rows, const double *J,
                             const double *off, int64_t height, double *band, double *slope);

#endif
