"""From a human's motion to a robot's: all steps of retargeting, in order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache, lru_cache

from threadpoolctl import ThreadpoolController

from wbc.errors import InvalidInputError, shown
from wbc.human import HumanMotion
from wbc.kinds import whole_number
from wbc.retargeting.constraint_projection import update_footprints
from wbc.retargeting.ground_forces import ground_forces
from wbc.retargeting.initial_guess import Progress
from wbc.retargeting.result import Retargeted
from wbc.retargeting.retries import MAX_ITERATIONS, solve_with_retries
from wbc.retargeting.robot_setup import RobotSetup, robot_setup
from wbc.retargeting.scaling import (
    FROUDE,
    MotionScale,
    momentum_notes,
    momentum_scale,
    motion_scale,
)
from wbc.retargeting.source import human_frames
from wbc.retargeting.targets import Targets, scaled_targets
from wbc.retargeting.tasks import FrameTasks, RetargetWeights
from wbc.retargeting.tracking_errors import (
    dissimilarity_notes,
    penetration_notes,
    tracking_errors,
    violations,
)
from wbc.retargeting.trajectory_problem import TrajectoryProblem
from wbc.robot import Robot
from wbc.robot.model import check_robot
from wbc.robot.series import centroidal_series, rates
from wbc.robot.tree import refuse_loops
from wbc.validate import Array, finite_number, read_only

RATE = 50.0  # Hz, as policy training reads it
FRICTION, MARGIN, MAX_MARGIN = 0.6, 0.01, 0.2  # 1, m, m
MAX_RATE = 1000.0  # Hz
MIN_FRAMES = 4  # of a motion with a jerk


def retarget(
    human: HumanMotion,
    robot: Robot,
    *,
    rate: float = RATE,
    duration: str | float = FROUDE,
    cutoff: float | None = None,
    roll: float = 1.0,
    balance: bool = True,
    friction: float = FRICTION,
    margin: float = MARGIN,
    self_collision: bool = True,
    weights: RetargetWeights | None = None,
    links: Mapping[str, str] | None = None,
    rounds: int = MAX_ITERATIONS,
    progress: Progress | None = None,
) -> Retargeted:
    """Return a human's motion on a humanoid.

    Lengths are scaled by those of the legs, angular momentum by m h sqrt(g h). Feet stand and roll
    where the human's do, and do not slide; CoM, angular momentum, the ellipsoid, pelvis, trunk,
    head and arms follow the human's, fingers are held as they stand. The initial guess is solved
    frame by frame by the tick, then a trajectory optimization takes all frames at once with the
    jerk of the joints (:mod:`wbc.retargeting.trajectory_problem`). Last, the motion is projected
    onto its hard constraints (:mod:`wbc.retargeting.constraint_projection`): feet that stand do not
    slide, limits, speeds and accelerations of joints, margins between bodies. Violations that
    remain are told (``broken``).

    Parameters
    ----------
    human:
        From :func:`wbc.human.human_motion`.
    robot:
        A humanoid with two feet with soles.
    rate:
        Frames per second of the result [Hz].
    duration:
        ``froude``: times scale with the square root of lengths, as between animals of different
        size; ``kept``: the human's time; or a factor. The time is stretched if joints would exceed
        their speeds, which is noted.
    cutoff:
        Of the low-pass filter on the human's motion [Hz]; None: by its steps.
    roll:
        Part of the pitch of the human's feet that the robot's have, in [0, 1]. With 0 soles are
        always level: steps get shorter, but ankles need not bear the weight on an edge.
    balance:
        Move the CoM so that the CoP is where the robot's feet stand.
    friction:
        Coefficient, for the distribution of wrenches and their check.
    margin:
        Kept between bodies [m], with ``self_collision``.
    weights:
        Of the tasks.
    links:
        Frames of the robot by part of the body, see :func:`wbc.retargeting.body_map.body_map`.
    rounds:
        Gauss-Newton iterations at most, each over the whole motion; most motions take four.
    progress:
        Called with frames done and frames in all.

    Returns
    -------
    Retargeted
        The motion with contacts, wrenches and torques; how near each task came; where it cannot be
        balanced as it is, and why.

    Raises
    ------
    InvalidInputError
        No human's motion, a robot that is no biped with soles or has closed loops, or numbers that
        make no sense.
    SolverError
        The least squares of the whole motion have no solution.
    """
    if not isinstance(human, HumanMotion):
        raise InvalidInputError(
            f"retarget: expected a human's motion, as wbc.human.human_motion(...) returns it, got"
            f" {shown(human)}"
        )
    check_robot("retarget", robot)
    refuse_loops("retarget", robot)
    rate = finite_number("retarget, rate", rate, least=10.0)
    if rate > MAX_RATE:
        raise InvalidInputError(f"retarget, rate: {rate:g} Hz is above {MAX_RATE:g}")
    roll = finite_number("retarget, roll", roll, least=0.0)
    if roll > 1.0:
        raise InvalidInputError(f"retarget, roll: {roll:g} is above 1, the human's own")
    friction = finite_number("retarget, friction", friction, above=0.0)
    margin = finite_number("retarget, margin", margin, least=0.0)
    if margin > MAX_MARGIN:
        raise InvalidInputError(
            f"retarget, margin: {margin:g} m between bodies is more than a robot's arms and legs"
            f" leave; give at most {MAX_MARGIN:g}, in metres"
        )
    rounds = whole_number("retarget, rounds", rounds, least=1)
    weights = RetargetWeights() if weights is None else weights
    setup = robot_setup(robot, links, margin if self_collision else None)
    scale = motion_scale(human, setup.robot, setup.legs, setup.standing, duration)
    cutoff = human.cutoff if cutoff is None else cutoff

    @lru_cache(maxsize=1)  # attempts differ in weights more often than in time
    def targets_at(scale: MotionScale) -> tuple[Targets, Array]:
        source = human_frames(human, rate * scale.time, cutoff, roll)
        if len(source) < MIN_FRAMES:
            raise InvalidInputError(
                f"retarget: {len(source)} frames remain at {rate:g} Hz, and a motion has at"
                f" least {MIN_FRAMES}: give a higher rate, or a longer duration"
            )
        return scaled_targets(source, setup, scale, balance), source.series.axes

    def build_problem(
        scale: MotionScale, weights: RetargetWeights
    ) -> tuple[TrajectoryProblem, Array]:
        targets, axes = targets_at(scale)
        return TrajectoryProblem(FrameTasks(setup, targets, weights), setup.collision), axes

    # LAPACK factorizes narrow bands: BLAS's threads wait for each other, up to 40 times as long.
    with _libraries().limit(limits=1, user_api="blas"):
        found = solve_with_retries(build_problem, scale, weights, rounds, balance, progress)
    notes, reduced = [*setup.notes, *setup.body.notes, *found.notes(scale.time)], setup.robot
    tasks = found.problem.tasks
    targets, k = tasks.targets, found.problem.states(found.q).part("momentum", 6)[:, 3:]
    factor = momentum_scale(k, targets.angular_momentum, tasks.momentum)
    feet, moved = update_footprints(targets.feet, reduced, found.q, targets.time)
    targets = replace(targets, feet=feet, angular_momentum=factor * targets.angular_momentum)
    notes += [*targets.notes, *momentum_notes(factor), *moved]
    notes += penetration_notes(reduced, targets, found.q)
    q = setup.fingers.all_joints(found.q)
    return evaluate(
        robot, setup, human.motion.source, found.scale, targets, q, friction, tuple(notes)
    )


@cache
def _libraries() -> ThreadpoolController:
    """Return the libraries with threads of their own; looking for them takes milliseconds."""
    return ThreadpoolController()


def evaluate(
    robot: Robot, setup: RobotSetup, source: str, scale: MotionScale, targets: Targets, q: Array,
    friction: float, notes: tuple[str, ...],
) -> Retargeted:  # fmt: skip
    """Return configurations (n, nq) of any origin as a motion with its errors and violations."""
    v, acceleration = rates(robot, q, targets.dt)
    whole = centroidal_series(robot, q, v, acceleration)
    supports = targets.feet.supports
    ground = ground_forces(robot, q, v, acceleration, whole, targets.time, supports, friction)
    found = Retargeted(
        robot=robot,
        source=source,
        scale=scale,
        time=targets.time,
        q=read_only(q),
        v=read_only(v),
        acceleration=read_only(acceleration),
        whole=whole,
        targets=targets,
        **vars(ground),
        reached=tracking_errors(robot, setup, targets, q, whole),
        broken=violations(setup, targets, q, v, acceleration),
        notes=notes,
    )
    return replace(found, notes=(*notes, *dissimilarity_notes(found)))
