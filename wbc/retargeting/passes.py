"""From a human's motion to a robot's: the passes, one after the other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from wbc.constraints import Limits
from wbc.errors import InvalidInputError, shown
from wbc.human import HumanMotion
from wbc.retargeting.by_tick import Progress, TickPass, between, first_configuration
from wbc.retargeting.ground_forces import ground_forces
from wbc.retargeting.mending import Mended, mended, resettled
from wbc.retargeting.not_kept import broken
from wbc.retargeting.prepared import Prepared, prepared
from wbc.retargeting.reaching import reached, unlike
from wbc.retargeting.result import Retargeted
from wbc.retargeting.scaling import FROUDE, MotionScale, scale_of
from wbc.retargeting.smoothing import Round, WholeMotion
from wbc.retargeting.source import human_frames
from wbc.retargeting.targets import Targets, balanced, scaled_targets
from wbc.retargeting.tasks import FrameTasks, RetargetWeights
from wbc.robot import Robot
from wbc.robot.model import check_robot
from wbc.robot.series import centroidal_series, rates
from wbc.robot.tree import refuse_loops
from wbc.validate import Array, finite_number, read_only

RATE = 50.0  # Hz: of what trainers of policies read
# Of the whole motion: a round that leaves WORSE times as much that is not kept, if that is much
# [m or rad], or tasks farther off, led astray; it is damped MORE, up to MOST.
WORSE, ASTRAY, MORE, MOST = 2.0, 0.02, 4.0, 100.0
# A round that gains no more of the sum of squares than this part is the last one, and one that
# leaves so little by frame.
SETTLED, ENOUGH = 0.05, 0.7
TRAPPED = 0.2  # rad or m: feet so far off after the first pass are behind something
LEAST_ROUNDS, ROUNDS = 2, 14
# What is nearly right is damped less from round to round, for light tasks such as arms to come to
# their targets, and more after so many if joints are too fast.
PATIENT, BOLDER, BOLDEST, CALMER, CALMEST = 6, 0.7, 1.0, 1.5, 15.0
FRICTION, MARGIN = 0.6, 0.01
# What is hard and cannot be kept is tried again, with so much less asked of the CoM, in so many
# times the time if joints would have to be faster or stronger.
TRIES, SOFTER, SLOWER = 5, 0.5, 1.2
# Joints that would be faster than they are by this and no more make the motion slower, by as much
# and a little but by no more than this at once, if what is mended in its own time is spoiled.
NEARLY, TOO_SLOW, MORE_SLOWLY, SLOWEST = 1.02, 4.0, 0.03, 1.5
SPOILED = 1.5  # times the sum of squares of what is not mended


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
    head and arms follow the human's. Frames are first solved one after the other by the tick, then
    all at once with the jerk of the joints (:mod:`wbc.retargeting.smoothing`), and last what is
    hard is kept (:mod:`wbc.retargeting.mending`): feet that stand do not slide, limits, speeds and
    accelerations of joints, margins between bodies. What is not is said (``broken``).

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
    legs, body, standing, collision = known.legs, known.body, known.standing, known.collision
    scale = scale_of(human, robot, legs, standing, duration)
    asked, notes = scale.time, list(body.notes)
    softer = 0
    hurried: tuple[Mended, WholeMotion, MotionScale] | None = None
    q: Array | None = None
    for number in range(TRIES):
        low = human.cutoff if cutoff is None else cutoff
        source = human_frames(human, rate * scale.time, low, roll)
        targets = scaled_targets(source, robot, legs, body, standing, scale, balance)
        tasks = FrameTasks(robot, body, targets, weights, legs.length)
        motion = WholeMotion(tasks, collision, legs.length)
        best = _solved(motion, source.series.axes, rounds, balance, progress, q)
        found = mended(motion, best.q)
        last, too_fast = number == TRIES - 1, NEARLY < best.speed < TOO_SLOW
        if found.kept and too_fast and not last:
            # Joints that are too slow may spoil a motion in its own time.
            hurried = (found, motion, scale) if hurried is None else hurried
            too_fast = motion.looked_at(found.q).cost > SPOILED * max(best.cost, ENOUGH)
        if last or (found.kept and not too_fast):
            break
        if too_fast and (found.kept or number == 0):
            slower = min(best.speed, SLOWEST) * (1.0 + (number + 1) * MORE_SLOWLY)
            scale = replace(scale, time=scale.time * slower)
            q = best.q if best.violation < ASTRAY else None
            continue
        q = None
        softer += 1
        # With less asked of CoM and momentum it may, and with more time motors be strong enough.
        weights = replace(weights, com=SOFTER * weights.com, momentum=SOFTER**2 * weights.momentum)
        if max(found.speed, found.force) > 1.0:
            scale = replace(scale, time=SLOWER * scale.time)
    if hurried is not None and not found.kept:  # slower it is not kept either: in its own time
        (found, motion, scale), softer = hurried, 0
    if scale.time != asked:
        notes.append(
            f"{scale.time / asked:.2f} times as slow as asked for: joints of {robot.name} are no"
            " faster, or no stronger"
        )
    if softer > 0:
        notes.append(
            f"CoM and momentum weigh less, {SOFTER**softer:g} and {SOFTER ** (2 * softer):g} times:"
            " limits and margins leave no more"
        )
    feet, moved = resettled(motion.tasks.targets.feet, robot, found.q)
    targets = replace(motion.tasks.targets, feet=feet)
    notes += [*targets.notes, *moved]
    return judged(
        robot, known, human.motion.source, scale, targets, found.q, friction, tuple(notes)
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
        broken=broken(robot, known.collision, targets, q, v, acceleration),
        notes=notes,
    )
    return replace(found, notes=(*notes, *unlike(found)))


def _solved(
    motion: WholeMotion, axes: Array, rounds: int, balance: bool, progress: Progress | None,
    begun: Array | None,
) -> Round:  # fmt: skip
    """Return the round whose configurations (n, nq) are as near to the targets as they come.

    What is hard is kept but for what tasks pull at it. ``begun``: those of the same motion in other
    time (m, nq), from which to go on.
    """
    tasks, collision = motion.tasks, motion.collision
    robot = tasks.robot
    constraints = [] if collision is None else [collision]
    limits = Limits(robot, velocity=None)
    if begun is None:
        start = first_configuration(tasks, constraints)
        q = TickPass(tasks, limits, constraints).run(start, progress)
    else:
        q = between(robot, begun, np.linspace(0.0, len(begun) - 1.0, len(tasks.targets.time)))
    states = motion.states(q)
    tasks.shape_like(states.inertia, axes)
    best = motion.looked_at(q, states)
    if begun is None and best.violation > TRAPPED:  # legs that do not get past each other
        freely = motion.looked_at(TickPass(tasks, limits, ()).run(start, progress))
        best = min(best, freely, key=lambda one: one.violation)
    for number in range(1, rounds + 1):
        q = motion.stepped(best)
        states = motion.states(q)
        if balance:
            k = states.part("momentum", 6)[:, 3:]
            tasks.targets = balanced(tasks.targets, robot, k, states.com)
        before, now = best, motion.looked_at(q, states)
        near, hurried = now.violation < ASTRAY, now.haste > NEARLY
        dearer = near and before.violation < ASTRAY and now.cost > before.cost
        if before.haste > NEARLY and now.haste < before.haste:
            dearer = False  # what joints are too slow or too weak for costs something
        if dearer or now.violation > max(WORSE * before.violation, ASTRAY):
            motion.damping *= MORE
            if motion.damping > MOST:
                break
            continue
        best = now
        if not near:
            continue
        steady = before.violation < ASTRAY and now.cost > (1.0 - SETTLED) * before.cost
        if hurried and number >= PATIENT and now.haste > (1.0 - SETTLED) * before.haste:
            hurried = not steady  # it gets no slower
        if number >= LEAST_ROUNDS and not hurried and (steady or now.cost < ENOUGH):
            break
        if number < PATIENT or now.haste <= NEARLY:
            motion.damping = max(BOLDER * motion.damping, BOLDEST)
        else:  # joints that are too fast move to and fro
            motion.damping = min(CALMER * motion.damping, CALMEST)
    return best
