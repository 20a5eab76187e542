/* The native core: arithmetic of one control tick on memory that the caller owns.
 *
 * No global, no allocation, no Python: every function reads and writes only what its arguments
 * point at, so that threads with memory of their own need no lock. Matrices are row-major; spatial
 * vectors linear first; rotations take local axes to the world's. cffi reads all
 * but the preprocessor's lines of this file, too, for Python: constants that Python needs are enums.
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
    const double *body; /* (joints, 10): mass, CoM, inertia xx xy xz yy yz zz about the CoM */
    const double *armature; /* (nv) rotor inertia */
    const double *gravity;  /* (3) */
} wbc_tree;

/* How far a measured quaternion's norm may be off 1, what is left of that, and the largest entry of a state;
 * the largest entry of a QP, whose square does not overflow. */
extern const double wbc_unit, wbc_unit_rounding, wbc_largest_state, wbc_largest_qp;

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

/* Write all that is known at (q, v) into state, and behind it some frames, given by their joints
 * and their placements (12 each) there. scratch holds 13 numbers a joint and 17 a column of v.
 * Returns 0. */
int wbc_state(const wbc_tree *tree, const double *q, const double *v, double *state,
              double *scratch, int64_t frames, const int64_t *joint, const double *placement);
/* Write frames, one behind the other, as they are in a state. Returns 0. */
int wbc_frames(const wbc_tree *tree, const double *state, int64_t count, const int64_t *joint,
               const double *placement, double *out);
/* Write the second derivative (nv, nv) by v of <G, I>, G as xx xy xz yy yz zz and I about the CoM, world axes.
 * work holds 13 (nv + 3) numbers. Returns 0. */
int wbc_inertia_hessian(const wbc_tree *tree, const double *state, double mass, const double *G,
                        double *work, double *H);
/* Write where q gets to over a displacement (nv), as Pinocchio integrates. Returns 0. */
int wbc_integrate(const wbc_tree *tree, const double *q, const double *step, double *out);
/* Write a state as measured, q then v (nq + nv): what is of norm 1 but for rounding is normalised.
 * Returns DONE, or NOT_FINITE for what is no measurement: Python says where and why. Python gives the bytes
 * of what is measured, here and to a tick: of doubles, though their type is void. */
int wbc_check(const wbc_tree *tree, const void *q, const void *v, double *out);
/* The same with v dt for v, and behind it where q gets to by that (nq). */
int wbc_move(const wbc_tree *tree, const double *q, const double *v, double dt, double *out);

/* Write how the momentum of such a state changes (6, nv) with the configuration if v stays as it is; scratch is as
 * wbc_state left it. A joint carries a momentum L and an inertia Y as one, at a twist S (about the CoM), and turns
 * them and the joints behind it against what it hangs on, which has the twist V:
 *
 *     dh = S x* L + Y (V x S), less the CoM's way x the linear momentum          (Featherstone 2008, ch. 2)
 *
 * Returns 0. */
int wbc_momentum_jacobian(const wbc_tree *tree, const double *state, const double *v, double *scratch,
                          double *out);

/* What is known at a velocity v besides: mass matrix (nv, nv), bias forces (nv), then at zero
 * acceleration of v the accelerations of CoM and momentum and, world axes, the first and second
 * derivative of the inertia; then of each joint, its origin and axes, how it moves. */
#define BIAS(nv) ((nv) * (nv))
#define DRIFTS(nv) (BIAS(nv) + (nv))
enum { COM_DRIFT = 0, MOMENTUM_DRIFT = 3, INERTIA_RATE = 9, INERTIA_CURVATURE = 15, DRIFTS_SIZE = 21 };
#define JOINT_MOTION(nv) (DRIFTS(nv) + DRIFTS_SIZE) /* (joints, 9) */
enum { OMEGA = 0, ALPHA = 3, ACCELERATION = 6, JOINT_MOTION_SIZE = 9 };
#define MOTION_SIZE(nv, joints) (JOINT_MOTION(nv) + JOINT_MOTION_SIZE * (joints))

/* Where parts begin in a state and in a motion, in their order; frames, end: where the rest begins. */
typedef struct {
    int64_t com, inertia, momentum, centroidal_map, com_jacobian, inertia_jacobian, twists, rotations;
    int64_t origins, frames;
} wbc_state_places;
typedef struct {
    int64_t mass_matrix, bias, com_drift, momentum_drift, inertia_rate, inertia_curvature, joints, end;
} wbc_motion_places;
int wbc_places(const wbc_tree *tree, wbc_state_places *state, wbc_motion_places *motion);

/* Write all that into motion; scratch holds 9 numbers a joint and 6 a
 * column. Returns 0. */
int wbc_motion(const wbc_tree *tree, const double *state, const double *v, double *motion,
               double *scratch);
/* Write the accelerations (6) of frames at zero acceleration of v. Returns 0. */
int wbc_drifts(const wbc_tree *tree, const double *state, const double *motion, int64_t count,
               const int64_t *joint, const double *placement, double *out);

/* Convex bodies on joints: hulls of corners with a radius, each in a capsule that is itself of two
 * corners and of one, and half-spaces on joint 0; and the pairs of them that are to be kept apart. */
enum { CAPSULES = 0, HULLS = 1, ABOVE = 2 }; /* HULLS: at least one; ABOVE: the second is a half-space */
typedef struct {
    int64_t nv, joints, bodies, pairs;
    const int64_t *joint;  /* (bodies) */
    const double *local;   /* (bodies, 3, 3) columns: start, unit direction, middle; joint's axes.
                            * Of a half-space: a point of its surface, its normal, the point */
    const double *size;    /* (bodies, 3): length, radius, radius of a ball about the middle */
    const int64_t *pair;   /* (pairs, 2) */
    const int64_t *kind;   /* (pairs) */
    const int64_t *common; /* (pairs): the last joint that carries both */
    const int64_t *first;  /* (bodies + 1): where a body's corners begin */
    const double *corner;  /* (3, corners) of all, joint's axes */
    const double *rounding; /* (bodies): about the hull of the corners */
    const double *shorter;  /* (pairs): length of the shorter body's core */
} wbc_pairs;

/* Write the numbers, increasing, of the count pairs of least distance, less kept (pairs) if that is
 * not 0, and of these (7, count): distance, normal to the first, point on the first. A distance of
 * -INFINITY: hulls touch, and how deep they are inside each other is not known here. Returns 0; -1: count
 * pairs do, or the state is not finite. scratch holds 10 numbers a body and 10 a pair. */
int wbc_nearest(const wbc_pairs *of, const double *state, int64_t count, const double *kept,
                double *scratch, int64_t *chosen, double *nearest);
/* Write (7, k) of k pairs, as wbc_nearest does. Returns 0. */
int wbc_measure(const wbc_pairs *of, const double *state, int64_t k, const int64_t *chosen,
                double *scratch, double *nearest);
/* Write frame and pair (k, 2), and what is nearest (k, 7), of all pairs of n states, stride numbers
 * from one to the next, that are less than limit above what they keep; the distance of pairs that
 * must be measured in Python is -INFINITY. Returns k, of which no more than room are written; -1: a
 * state is not finite. */
int64_t wbc_within(const wbc_pairs *of, const double *states, int64_t n, int64_t stride,
                   double limit, const double *kept, double *scratch, int64_t room,
                   int64_t *chosen, double *nearest);
/* How bodies close, and how they stop: wbc/robot/collision/native_pairs.py. */
typedef struct {
    const double *twist;    /* (k, 6): linear part at the world's origin, then angular */
    const int64_t *carrier; /* (bodies): which of them is each body's */
    double dt, slowest;
    double least; /* dt / gain */
    double half;  /* 0.5 / deceleration */
} wbc_closing;
/* As wbc_nearest, of least distance less kept and what they need to stop in; left (count): that. Returns 1,
 * too: more than count may not stop in time. */
int wbc_soonest(const wbc_pairs *of, const double *state, int64_t count, const double *kept,
                const wbc_closing *closing, double *scratch, int64_t *chosen, double *nearest, double *left);
/* Write the derivatives (k, nv) of distances by v; normals and points (3, k). Returns 0. */
int wbc_pair_rows(const wbc_pairs *of, const wbc_tree *tree, const double *state, int64_t k,
                  const int64_t *chosen, const double *normal, const double *point, double *rows);
/* Write bounds (k) on how far distances end below their linear prediction over a step (nv). turns holds a
 * number a joint. Returns 0. */
int wbc_bends(const wbc_pairs *of, const wbc_tree *tree, const double *step, int64_t k, const int64_t *chosen,
              double *turns, double *bends);

/* A margin between those pairs: wbc/constraints/margin.py and collision.py. */
typedef struct {
    const wbc_pairs *of;
    const double *kept;         /* (pairs): distance, skin included */
    const double *acceleration; /* (nv - 6) of joints that braking may count on, or 0 */
    int64_t rows;               /* pairs that get one, those of least clearance: see soonest */
    double deceleration, gain, recovery, recovery_speed;
} wbc_margin;

/* What margins count on, here and in Python; said in source/margin.c. */
extern const double wbc_skin, wbc_used, wbc_rounding, wbc_interior, wbc_part, wbc_lever, wbc_margin_braking,
    wbc_margin_leaving;
/* Write how fast clearances (k) may change by the margin's braking, of rows (k, nv): negative, or positive where
 * they have to grow. dt: of a tick. Of the margin its law is read alone. Returns 0. */
int wbc_approach(const wbc_margin *margin, int64_t nv, double dt, int64_t k, const double *rows,
                 const double *clearance, double *least);

/* What a row asks for: the kinds that wbc/native/rows.py describes. */
enum row_kind { POINT = 0, ORIENTATION = 1, INERTIA_ENTRIES = 2, JOINTS = 3, MOMENTUM_ENTRIES = 4,
                CONTACT = 5, LINEAR = 6, GIVEN = 7, LOOP = 8, GEAR = 9, ASKED = 10, COP = 11,
                POINTING = 12, RELATIVE = 13 };
/* A block of rows: what they are, where they stand among the costs or the contacts, where their
 * selection begins in index and their numbers in number, which frame they are about (-1: the CoM, or
 * the world), their level among the costs, and whether the curvature that they leave out is in the cost
 * (second: of INERTIA_ENTRIES, ASKED), or damped; other is the frame that a LOOP's is held at, or a
 * RELATIVE's is seen from, or where a COP's rows begin in moments. */
typedef struct {
    int64_t kind, held, rows, first, frame, index, number, level, second, other;
} wbc_block;
/* Numbers of a block: those of its law; weights (rows); biases (rows); what the target's motion adds
 * to the drifts (rows); then those of its kind. ASKED rows are answers of a task in Python: all of their drifts
 * in place of a part, Jacobian (rows, nv), error (rows), a bound on the curvature (nv) and, if second, the
 * curvature (nv, nv). GIVEN rows, of forces: matrix (rows, n) and target (rows). COP rows are the horizontal
 * moment of all contacts' forces about a point (3), or of a frame's contact, in its axes; then whether the point
 * is as high as their frames are on the mean. Errors of both are what the answer misses [N, N m]. */
enum { RATE = 0, HALF_GAIN = 1, LM_DAMPING = 2, STIFFNESS = 0, DAMPING = 1, WEIGHTS = 3 };

/* What a contact bears, as unknowns: forces at corners, or (corners 0) one along each of its rows. */
typedef struct {
    int64_t block;   /* the contact's */
    int64_t column;  /* the first force, among the forces */
    int64_t corners; /* three forces each */
    int64_t corner;  /* where they begin among the corners' coordinates (3 each), frame's axes */
    int64_t count;   /* rows */
    int64_t aligned; /* whether forces are in the world's axes, not the frame's */
} wbc_force;

/* A tick: levels of costs, contacts met exactly, a box, inequality rows; made once, its numbers follow
 * the tasks. The unknowns are v+ (nv) and, at the torque level, contact forces. */
typedef struct {
    const wbc_tree *tree;
    const wbc_block *block;
    const int64_t *index;
    const double *number;
    const int64_t *frame_joint;    /* (frames); the first is the base; behind them, ends of loops */
    const double *frame_placement; /* (12) of each */
    const int64_t *start;          /* (nv - 6): where a joint's coordinate is in q */
    const double *damping;         /* (nv + forces) */
    const double *limit; /* (5, nv - 6): lower, upper, speed, and how fast joints speed up and
                          * brake; (2, 6): the base's */
    const wbc_force *force;
    const double *corner;
    const int64_t *passive;      /* (passives): entries of v without a motor */
    const int64_t *with_bound;   /* (bounded): entries of v with a torque bound */
    const double *torque_bound;  /* (bounded), in units of the forces, as all that follows */
    const double *cone;          /* (cones, forces), lower (cones), upper (cones) */
    const double *force_bound;   /* (2, forces): lower, upper */
    const double *joint_damping; /* (nv - 6) [N m s/rad] */
    const double *load;          /* (nv) forces that nobody commands: of springs [N, N m] */
    const double *given; /* inequality rows on v+ that were worked out by others: matrix (given_rows, nv),
                          * lower, upper, and how far they give way by their multipliers (given_rows) */
    const double *push;  /* what they push at, as a cost that outweighs all others: matrix (pushes, nv),
                          * target, weight (pushes) */
    const double *added; /* (held) to the errors of loops and gears: what a tick is not to take back */
    double *rows; /* of all costs: matrix (costs, n), target (costs), bias (costs); of each level, what it is
                   * damped by (nv); if curved, the curvature that its rows leave out (nv, nv). 0 where
                   * there is one level that nobody looks into. */
    double *moments; /* (COP rows, forces) of a tick */
    double *below; /* the QP of the last level below the first: see source/levels.c */
    double *state;               /* what is found at a state that nobody has looked at */
    double *out;
    double *scratch;
    int64_t *order;       /* the second of wbc_sizes, and (k) to keep, (pairs) of a margin */
    const wbc_margin *margin; /* rows behind all others, or 0 */
    int64_t blocks, frames, costs, held, limited;
    int64_t torque, forces, bearing, passives, bounded, cones, wide; /* wide: see wbc_qp */
    int64_t levels, curved, given_rows, soft, pushes; /* soft: whether given rows give way */
    int64_t braked;  /* whether a joint's acceleration bounds how it slows down, too */
    int64_t outside; /* whether the reduced QP is solved by others */
    int64_t always;  /* whether a solver is asked where the optimum of the cost alone would do, too */
    int64_t most;    /* iterations of the active-set method */
    int64_t solving; /* where in scratch ends what QPs are solved in */
    int64_t usual;   /* where in order the columns begin that the last tick eliminated: see wbc_sizes */
    int64_t closing; /* whether loops and gears are closed where the command leads: source/closing.c */
    double dt, mass, unit, eps; /* unit: newtons per unit of a force; eps: as in wbc_qp */
    double recovery; /* part of what a joint is outside its limits that is taken back in a tick */
} wbc_plan;

/* minimise 1/2 x'P x + g'x subject to A x = b, l <= C x <= u, lower <= x <= upper; n unknowns, k
 * equalities, m rows. Of a plan besides: D, offset: base forces and torques by x, at the torque
 * level; errors of the costs, and the largest square of a weighted row. */
typedef struct {
    int64_t n, k, m, wide; /* wide: from there on P has entries on its diagonal alone */
    double eps; /* an answer of larger residuals is none */
    double *P, *A, *C, *g, *lower, *upper, *b, *l, *u;
    double *x, *y, *z, *z_box, *found; /* the answer; residuals (3), iterations, levels solved */
    double *D, *offset, *errors, *heaviest;
    double *exact, *torque; /* (nv), (nv - 6): see command in source/levels.c */
    double *clearance, *chosen; /* of the margin's rows, and numbers of their pairs */
} wbc_qp;

/* What there is to say of a tick. UNSOLVED: the QP is there, but no answer; INFEASIBLE: no point meets
 * all its rows, and y, z and z_box are a certificate: see wbc_solve_qp. NOT_MEASURED: of some pair;
 * LEADS_INSIDE: a margin, or it cannot be seen where the answer leads. MORE_ROWS: of pairs that could not
 * stop in time, than the plan has. REDUCED: to who solves it, outside. */
enum said { INFEASIBLE = -2, UNSOLVED = -1, DONE = 0, NOT_FINITE = 3, NOT_MEASURED = 4,
            LEADS_INSIDE = 5, MORE_ROWS = 6, REDUCED = 7, OUTLIER = 8 };
/* Write the QP of the first level. state is plan->state with what wbc_state wrote at (q, v) without frames, or
 * 0: then it is found here. v may be 0, here and below: it lies behind q then. */
int wbc_problem(const wbc_plan *plan, const double *state, const void *measured, const double *v);
/* The same and the answer of all levels: x, y, z, z of the box of each QP; primal, dual and complementarity
 * residuals, iterations, and of the first how many levels were solved. The equalities are eliminated;
 * where the optimum of the cost alone keeps all bounds and rows, that is the answer, in 0 iterations. Else
 * what is left is solved by the active-set method; or, if it is to be solved outside, REDUCED is returned,
 * and how many rows C there are is the first residual. */
int wbc_tick(const wbc_plan *plan, const double *state, const void *measured, const double *v);
/* Write P (n, n) and g (n) of one level's costs and damping, or of all levels together (-1). */
int wbc_cost(const wbc_plan *plan, const double *q, const double *v, int64_t level, double *P,
             double *g);
/* Step by step, for who changes the QPs of levels (their g, say) before they are solved: write the QP of
 * a level below the first, from the answer of the level above; solve a level; write the command of the
 * last one that was solved (wbc_finish). */
int wbc_pose(const wbc_plan *plan, const double *q, const double *v, int64_t level);
int wbc_solve(const wbc_plan *plan, int64_t level);
int wbc_finish(const wbc_plan *plan, const double *q, const double *v);
/* The levels below the first, whose answer was written by others, and the command. */
int wbc_descend(const wbc_plan *plan, const double *q, const double *v);
/* Outside a tick: write what the blocks of a plan, all of them held, are about: matrix (held, nv), errors (held),
 * their biases (held), drifts (held), and a bound on the curvature that they leave out (1). motion: what
 * wbc_motion wrote there; 0: no drifts. scratch holds the plan's frames, and 6 numbers of each. Returns 0. */
int wbc_rows(const wbc_plan *plan, const double *state, const double *motion, const double *q,
             const double *v, double *out);
/* Outside a tick, too: write the box on v+ (2, nv), lower then upper bounds. Returns 0. */
int wbc_box(const wbc_plan *plan, const double *q, const double *v, double *box);
/* From where on loops and gears count as open, and up to where they are closed by steps; source/closing.c. */
extern const double wbc_closed, wbc_far_open;
enum { CLOSING_ROUNDS = 5 }; /* each leaves a gap by that part which joints move in a tick [rad] */
/* Write how far loops and gears are open (held) where v leads in dt from a state at q, 0 for rows that do not
 * bend. Returns how many do. */
int64_t wbc_gaps(const wbc_plan *plan, const double *state, const double *q, const double *v, double *gaps);
/* Where the reduced QP begins in scratch: P (left, left), g, lower and upper bounds (left + rows) of
 * x and then of C x, C (rows, left); and left. Returns 0. */
int wbc_reduced(const wbc_plan *plan, int64_t *begin);
/* After that: the first level's answer from the reduced QP's, x (left) and multipliers of rows, then of
 * bounds, times scale; x 0: by the active-set method. May be called again; then wbc_descend. */
int wbc_answer(const wbc_plan *plan, const double *x, const double *z, double scale,
               int64_t iterations);
/* Write how many numbers and integers a QP of n unknowns, k equalities (loops of them of loops and gears) and m
 * rows is solved in, and where in the integers begin those that last. */
int wbc_sizes(int64_t n, int64_t k, int64_t m, int64_t loops, int64_t *sizes);
/* Write where a level's QP lies: n, k, m, and where in out (of levels below the first, what they have of
 * their own: in below) P A C g lower upper b l u x y z z_box found D offset errors heaviest exact torque
 * clearance chosen begin; last, how many numbers out and below hold. */
enum { LAYOUT = 27 };
int wbc_layout(const wbc_plan *plan, int64_t level, int64_t *at);
/* Solve any QP by the active-set method, in at most most iterations. give (m), or 0: rows are
 * l <= C x - s <= u at the cost of 1/2 s^2 / give, s = 0 where give is 0. INFEASIBLE: y, z, z_box are a
 * Farkas certificate: y'A + z'C + z_box' = 0, and their sum by the ends that they point at is below 0. */
int wbc_solve_qp(const wbc_qp *qp, const double *give, int64_t most, double *scratch,
                 int64_t *order);
/* The same of one whose P A C g lower upper b l u lie behind each other in numbers; x y z z_box and four numbers of
 * found are written to out, behind which it works. */
int wbc_solve_flat(int64_t n, int64_t k, int64_t m, double *numbers, double eps, int64_t most, double *out,
                   int64_t *order);

/* Write how far x, y, z and z_box are from optimal: primal, dual and complementarity residual into found (3).
 * gradient (n) is scratch. Returns 0. */
int wbc_residuals(const wbc_qp *qp, double *gradient);

/* Move the ends (2, 3) of a capsule round points (count, 3), its radius the distance of the farthest, to where
 * its volume is small: from steps of size [m], until corners of the search differ by no more than the
 * accuracies [m, m^3], or most steps are made. Returns 0. */
int wbc_fit_capsule(int64_t count, const double *points, double size, int64_t most, double accuracy,
                    double value_accuracy, double *ends);

/* An invariant filter of an IMU and of feet that stand (source/filter.c). x: rotation of the IMU, velocity,
 * position, biases of gyroscope and accelerometer, then of each foot position and rotation; world axes, the
 * biases in the IMU's. P (n, n), n = 15 + 6 feet: of the errors of rotation, velocity, position, biases, then
 * of each foot position and rotation; rows of feet that are not held are 0. */
enum { FILTER_V = 9, FILTER_P = 12, FILTER_GYRO = 15, FILTER_ACCEL = 18, FILTER_FEET = 21,
       FILTER_FOOT_SIZE = 12 };
typedef struct {
    int64_t feet;
    int64_t *held;                                     /* (feet) whether they stand */
    double *x, *P, *scratch;                           /* scratch: 7 n */
    double *origin;                                    /* (3) of positions in x, which moves along */
    double gravity[3];
    double gyroscope, accelerometer;                   /* noise densities, squared */
    double gyroscope_walk, accelerometer_walk;         /* of the biases, squared */
    double creep, roll;                                /* of feet that stand, squared */
} wbc_filter;
/* Begin anew with rotation, velocity, position and biases (21), no foot held, and the covariance (15, 15) of
 * estimate minus truth, 0 if that is 0. Returns 0, as all but wbc_filter_correct. */
int wbc_filter_reset(const wbc_filter *filter, const double *state, const double *covariance);
/* Go on with another IMU of the same body: arm (3) from the old one in world axes, its rotation (3, 3) to the
 * world; its biases (6) and their variances, and what is added to the velocity's. Holds no foot. */
int wbc_filter_follow(const wbc_filter *filter, const double *arm, const double *rotation,
                      const double *biases, const double *bias_variances, double velocity_variance);
/* Add to the velocity's variance, for what was not seen. */
int wbc_filter_widen(const wbc_filter *filter, double variance);
/* Move on by dt with the IMU's mean rate and specific force (3) over it; scale: of its variance. Returns 0. */
int wbc_filter_predict(const wbc_filter *filter, const double *rate, const double *force, double dt,
                       double scale);
/* Let a foot stand where it is: place, position (3) and rotation (3, 3) seen from the IMU, noise (6, 6) of it
 * in the IMU's axes. Returns 0. */
int wbc_filter_hold(const wbc_filter *filter, int64_t foot, const double *place, const double *noise);
int wbc_filter_release(const wbc_filter *filter, int64_t foot);
/* Correct by where a foot that stands is seen, by its position (rows 3) or its rotation, too (6). innovation:
 * normalised square, then position and rotation (7). DONE, OUTLIER: beyond gate, nothing was changed. */
int wbc_filter_correct(const wbc_filter *filter, int64_t foot, const double *place, const double *noise,
                       int64_t rows, double gate, double *innovation);
/* Write the covariance (15, 15) of errors as differences, estimate minus truth, in world axes. Returns 0. */
int wbc_filter_covariance(const wbc_filter *filter, double *out);
/* Write where a foot is seen from the IMU, place (15): position, rotation, and velocity by joints that move at
 * rates (nv - 6); and how surely, noise (6, 6): by the variance of the joints' positions, and floor (2), of
 * position and rotation besides. imu, foot: frames, as wbc_frames writes them. Returns 0. */
enum { PLACE_VELOCITY = 12, PLACE_SIZE = 15 };
int wbc_foot_place(int64_t nv, const double *imu, const double *foot, const double *rates, double variance,
                   const double *floor, double *place, double *noise);
/* Speed in the world of a foot that is seen there, by the filter's velocity and the IMU's rate (3). */
double wbc_filter_foot_speed(const wbc_filter *filter, const double *rate, const double *place);
/* Write the base's position and quaternion x y z w (7), and the velocity (nv) of all, by the filter and the
 * IMU's rate (3), with joints that move at rates (nv - 6). imu: its frame, the base at the origin. Returns 0. */
int wbc_filter_base(const wbc_filter *filter, int64_t nv, const double *imu, const double *rate,
                    const double *rates, double *q, double *v);

/* Forces from outside by residuals of the momentum (source/momentum.c). From call to call it keeps what is
 * known at the last state, residual (nv), velocity (nv) and motion, in base axes; wrenches (feet, 6) on the
 * soles, world axes. scratch: as of wbc_state and wbc_motion, whichever is more. */
enum { MOMENTUM_MOST_FEET = 4 };
typedef struct {
    const wbc_tree *tree;
    int64_t feet;
    const int64_t *joint;    /* (feet), and placements there (feet, 12) */
    const double *placement;
    const double *damping, *friction; /* (nv - 6) */
    double base_trust;                /* weight of the base's rows by the joints' */
    double bandwidth;                 /* what acts is seen with a delay of 1 / bandwidth */
    double *known;                    /* (1) whether a state was taken in */
    double *residual, *velocity, *motion, *state, *frames, *wrenches, *scratch;
} wbc_momentum;
/* Take in a state (q, v) and the torques (nv - 6) over the dt before. Returns 0. */
int wbc_momentum_update(const wbc_momentum *momentum, const double *q, const double *v,
                        const double *torque, double dt);


/* A robot's state by its sensors, message by message (source/estimator.c): IMUs, encoders, and which feet
 * bear, by sensors of their own or by the motors' torques. x and counts are all that it remembers, besides
 * filter and momentum; wbc_estimator_sizes says how many. All else that is written is scratch. */
enum { MOST_IMUS = 16 };
typedef struct {
    const wbc_tree *tree;
    const wbc_filter *filter;
    const wbc_momentum *momentum;
    int64_t imus, feet, window, waiting; /* readings of a joint's velocity; messages kept in the beginning */
    const int64_t *joint, *flat;         /* (imus + feet) which carry them; (feet) whether they have soles */
    const double *placement;             /* (imus + feet, 12) */
    const double *fastest;               /* (nv - 6) of joints: what moved faster jumped */
    const double *range;                 /* (imus, 2) of rate and force */
    const double *start;                 /* (7) base pose to begin at; quaternion 0: none */
    double weight, encoder_variance, encoder_delay, floor[2], bias_variances[2];
    double standing_time, load[2], estimated_load[2], settle, still, slides, sliding, apart, lost, timeout;
    double *x;
    int64_t *counts;
    double *frames, *state, *scratch, *wait, *detail; /* frames: imus, feet, and the IMU that is used */
    int64_t *event;
} wbc_estimator;
/* One message. velocities and torques (nv - 6), and loads of feet by the weight may be 0: unknown. */
typedef struct {
    double time;
    const double *positions, *velocities, *torques, *loads;
    const double *imu;    /* (imus, 6) rate, specific force */
    const int64_t *heard; /* (imus) whether it says anything */
} wbc_sample;
/* What counts begins with; then of each foot whether it is counted on, and whether it slips. */
enum { LEADER = 0, MEMBERS = 1, READINGS = 2, BELIEVES = 3, FEELS = 4, BEGUN = 5, WAITS = 6, NIS_ROWS = 7,
       FEET_STAND = 8 };
/* An estimate: covariance (15, 15), biases, normalised innovation squared, wrenches on soles (feet, 6), then
 * velocity (nv) and configuration (nq). */
enum { OUT_GYRO = 225, OUT_ACCEL = 228, OUT_SQUARED = 231, OUT_WRENCHES = 232 };
/* What was noted: how often, then kind and whose (TAKES_OVER: MOST_IMUS times whose place, and who); beside it in detail how much (detail[k], of the kth). */
enum noted { RATE_BEYOND, FORCE_BEYOND, HANGS, TAKES_OVER, LEFT_OUT, HELD, GAP, JOINT_JUMPED, NO_LOADS, COUNTED_ANYWAY,
             SLIPS, ROLLS, ROLLS_OVER, OUTSIDE, SLIPPED_OFF, FEET_APART };
/* Why there is no estimate: it stands to begin, no reading of the IMU, gravity is not that of a robot at rest
 * (detail[0]), or NOT_FINITE. */
enum { STANDING = 20, NO_IMU = 21, NO_GRAVITY = 22, NO_ESTIMATE = 23 };
/* Write how many x, counts, wait, event (detail: half of it), out without q, and frames hold. */
int wbc_estimator_sizes(const wbc_estimator *e, int64_t *sizes);
/* Forget all; stand to begin. */
int wbc_estimator_reset(const wbc_estimator *e);
/* Take in a message, later than the last one; write the estimate. */
int wbc_estimator_update(const wbc_estimator *e, const wbc_sample *s, double *out);
/* Take in a reading of joints (n) at a time; write the slope (n) of the line through the last window ones.
 * times (window) and positions (window, n) keep them, count says how many there are. */
int wbc_joint_rates(int64_t window, int64_t n, double *times, double *positions, int64_t *count, double time,
                    const double *reading, double *rates);

/* Add squares of rows J d + off (count, rows, span nv), the kth over the displacements of frames k to k + span - 1:
 * J'J to a matrix whose column j has its diagonal and what is below it at j height, J'off to slope. Returns 0. */
int wbc_band(int64_t count, int64_t nv, int64_t span, int64_t rows, const double *J, const double *off,
             int64_t height, double *band, double *slope);

#endif
