"""From a human's motion to a robot's: the passes, one after the other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

from wbc.errors import InvalidInputError, shown
from wbc.human import HumanMotion
from wbc.retargeting.by_tick import Progress
from wbc.retargeting.ground_forces import ground_forces
from wbc.retargeting.mending import resettled
from wbc.retargeting.prepared import Prepared, prepared
from wbc.retargeting.reaching import broken, reached, sunk, unlike
from wbc.retargeting.result import Retargeted
from wbc.retargeting.scaling import FROUDE, MotionScale, scale_of
from wbc.retargeting.smoothing import WholeMotion
from wbc.retargeting.source import human_frames
from wbc.retargeting.targets import Targets, scaled_targets
from wbc.retargeting.tasks import FrameTasks, RetargetWeights
from wbc.retargeting.tries import ROUNDS, kept
from wbc.robot import Robot
from wbc.robot.model import check_robot
from wbc.robot.series import centroidal_series, rates
from wbc.robot.tree import refuse_loops
from wbc.validate import Array, finite_number, read_only

RATE = 50.0  # Hz: of what trainers of policies read
FRICTION, MARGIN = 0.6, 0.01


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
    rounds: int = ROUNDS,
    progress: Progress | None = None,
) -> Retargeted:
    """Return a human's motion on a humanoid.

    Lengths are scaled by those of the legs, angular momentum by m h sqrt(g h). Feet stand and roll
    where the human's do, and do not slide; CoM, angular momentum, the ellipsoid, pelvis, trunk,
    head and arms follow the human's, fingers are held as they stand. Frames are first solved one
    after the other by the tick, then all at once with the jerk of the joints
    (:mod:`wbc.retargeting.smoothing`), and last what is hard is kept
    (:mod:`wbc.retargeting.mending`): feet that stand do not slide, limits, speeds and accelerations
    of joints, margins between bodies. What is not is said (``broken``).

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
        size; ``kept``: the human's time; or a factor. Either is stretched if joints would have to
        be faster than they are, which is noted.
    cutoff:
        Of the human's low-pass [Hz]; None: by its steps.
    roll:
        Part of the pitch of the human's feet that the robot's have, in [0, 1]. With 0 soles are
        always level: steps get shorter, but ankles need not bear the weight on an edge.
    balance:
        Move the CoM so that the CoP is where the robot's feet stand.
    friction:
        Coefficient, by which wrenches are shared and judged.
    margin:
        Kept between bodies [m], with ``self_collision``.
    weights:
        Of the tasks.
    links:
        Frames of the robot by part of the body, see :func:`wbc.retargeting.body_map.body_map`.
    rounds:
        Of the whole motion at once, at most: most take four.
    progress:
        Called with frames done and frames in all, of all passes.

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
    roll = finite_number("retarget, roll", roll, least=0.0)
    if roll > 1.0:
        raise InvalidInputError(f"retarget, roll: {roll:g} is above 1, the human's own")
    friction = finite_number("retarget, friction", friction, above=0.0)
    margin = finite_number("retarget, margin", margin, least=0.0)
    rounds = int(finite_number("retarget, rounds", rounds, least=1.0))
    weights = RetargetWeights() if weights is None else weights
    known = prepared(robot, links, margin if self_collision else None)
    hands, legs, body, standing, collision, _ = known
    moved_as = hands.robot
    scale = scale_of(human, moved_as, legs, standing, duration)
    low = human.cutoff if cutoff is None else cutoff

    @lru_cache(maxsize=1)  # tries differ in what is asked more often than in time
    def aims(scale: MotionScale) -> tuple[Targets, Array]:
        source = human_frames(human, rate * scale.time, low, roll)
        targets = scaled_targets(source, moved_as, legs, body, standing, scale, balance)
        return targets, source.series.axes

    def problem(scale: MotionScale, weights: RetargetWeights) -> tuple[WholeMotion, Array]:
        targets, axes = aims(scale)
        return WholeMotion(FrameTasks(moved_as, body, targets, weights, legs), collision), axes

    found = kept(problem, scale, weights, rounds, balance, progress)
    notes = [*known.notes, *body.notes, *found.notes(scale.time)]
    feet, moved = resettled(found.motion.tasks.targets.feet, moved_as, found.q)
    targets = replace(found.motion.tasks.targets, feet=feet)
    notes += [*targets.notes, *moved, *sunk(moved_as, targets, found.q)]
    q = hands.of_all_joints(found.q)
    return judged(
        robot, known, human.motion.source, found.scale, targets, q, friction, tuple(notes)
    )


def judged(
    robot: Robot, known: Prepared, source: str, scale: MotionScale, targets: Targets, q: Array,
    friction: float, notes: tuple[str, ...],
) -> Retargeted:  # fmt: skip
    """Return configurations (n, nq), wherever they come from, as a motion with all that is told."""
    v, acceleration = rates(robot, q, targets.dt)
    whole = centroidal_series(robot, q, v, acceleration)
    stands = targets.feet.supports
    ground = ground_forces(robot, q, v, acceleration, whole, targets.time, stands, friction)
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
        wrenches=ground.wrenches,
        torque=ground.torque,
        cop=ground.cop,
        reached=reached(robot, known.body, targets, q, whole, known.standing.com_height),
        unbalanced=ground.unbalanced,
        broken=broken(known, targets, q, v, acceleration),
        notes=notes,
    )
    return replace(found, notes=(*notes, *unlike(found)))
