"""From a human's motion to a robot's: the passes, one after the other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wbc.constraints import Limits, SelfCollision
from wbc.errors import InvalidInputError, shown
from wbc.gait.legs import Legs
from wbc.human import HumanMotion
from wbc.retargeting.body_map import BodyMap
from wbc.retargeting.by_tick import Progress, TickPass, apart, first_configuration, kept
from wbc.retargeting.ground_forces import ground_forces
from wbc.retargeting.prepared import prepared
from wbc.retargeting.reaching import reached
from wbc.retargeting.result import Retargeted
from wbc.retargeting.scaling import FROUDE, MotionScale, StandingBody, scale_of
from wbc.retargeting.smoothing import WholeMotion, able_accelerations
from wbc.retargeting.source import human_frames
from wbc.retargeting.targets import Targets, balanced, scaled_targets
from wbc.retargeting.tasks import FrameTasks, RetargetWeights
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.model import check_robot
from wbc.robot.series import centroidal_series, rates, velocities
from wbc.robot.tree import refuse_loops
from wbc.validate import Array, finite_number, read_only

RATE = 50.0  # Hz: of what trainers of policies read
# Of the whole motion: at least, and at most; it is done when this much was lacking before.
# A round that leaves WORSE times as much is taken back, if that is much, and damped MORE.
SETTLED = 0.07  # rad or m: a round that moves nothing more than this is the last one
WORSE, ASTRAY, MORE, TOLD = 2.0, 5e-3, 5.0, 1e-3
TRAPPED = 0.2  # rad or m: feet so far off after the first pass are behind something
LEAST_ROUNDS, ROUNDS, CLOSE = 4, 14, 5e-4
# What is nearly right is damped less from round to round, for light tasks such as arms to come to
# their targets, and more after so many. Fitted shapes may be a little too near: then those of the
# files are looked at.
PATIENT, BOLDER, BOLDEST, CALMER, CALMEST, GRAZED = 6, 0.7, 1.0, 1.5, 15.0, 2e-3
FRICTION, MARGIN = 0.6, 0.01
# Joints that would be faster than their limits make the whole motion slower, by so much more, and
# by as much again each time that this was not enough.
SLOWER, TRIES = 0.03, 4
SOFTER = 0.5
NO_LIMIT = 1e6  # rad/s^2


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
    all at once with the jerk of the joints (:mod:`wbc.retargeting.smoothing`), and what comes out
    is followed by the tick again, with all limits and margins hard.

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
    legs, body, standing, collision = known
    scale = scale_of(human, robot, legs, standing, duration)
    asked, notes = scale.time, list(body.notes)
    for number in range(1, TRIES + 1):
        low = human.cutoff if cutoff is None else cutoff
        source = human_frames(human, rate * scale.time, low, roll)
        targets = scaled_targets(source, robot, legs, body, standing, scale, balance)
        tasks = FrameTasks(robot, body, targets, weights, legs.length)
        axes = source.series.axes
        solved = _solved(tasks, legs, collision, axes, rounds, balance, progress)
        forced = rates(robot, solved.q, targets.dt)[1][:, BASE_NV:] / able_accelerations(robot)
        if solved.lacking > TOLD or np.abs(forced).max() > 1.0:
            # With less asked of CoM and momentum it may settle, and motors be strong enough.
            easier = replace(
                weights, com=SOFTER * weights.com, momentum=SOFTER**2 * weights.momentum
            )
            softer = FrameTasks(robot, body, targets, easier, legs.length)
            again = _solved(softer, legs, collision, axes, rounds, balance, progress)
            if again.lacking < max(solved.lacking, TOLD):
                tasks, solved = softer, again
        wanted, lacking = solved.q, solved.lacking
        speed, joint = _fastest(robot, wanted, targets.dt)
        if speed <= 1.0 or lacking > ASTRAY:  # what is not solved says nothing of speeds
            break
        scale = replace(scale, time=scale.time * (1.0 + number * SLOWER) * speed)
    limits = Limits(robot, acceleration=NO_LIMIT)  # what is too much is said by its torque
    q, failed = kept(tasks, wanted, limits, collision, progress, apart_already=solved.apart)
    if scale.time != asked:
        notes.append(
            f"{scale.time / asked:.2f} times as slow as asked for: {joint} of {robot.name} is no"
            " faster"
        )
    if lacking > TOLD:
        notes.append(
            f"all frames at once did not settle: feet, limits or margins were off by {lacking:.2g}"
            " (m or rad) before the last pass; this motion is too much for the robot somewhere"
        )
    if failed:
        first = min(failed)
        notes.append(
            f"what is hard could not be kept from {len(failed)} frames of the last pass on, the"
            f" first at {targets.time[first]:.2f} s: {failed[first]}"
        )
    notes += targets.notes
    return judged(
        robot, body, standing, human.motion.source, scale, tasks.targets, q, friction, tuple(notes)
    )


def judged(
    robot: Robot, body: BodyMap, standing: StandingBody, source: str, scale: MotionScale,
    targets: Targets, q: Array, friction: float, notes: tuple[str, ...],
) -> Retargeted:  # fmt: skip
    """Return configurations (n, nq), wherever they come from, as a motion with all that is told."""
    v, acceleration = rates(robot, q, targets.dt)
    whole = centroidal_series(robot, q, v, acceleration)
    stands = targets.feet.supports
    ground = ground_forces(robot, q, v, acceleration, whole, targets.time, stands, friction)
    return Retargeted(
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
        reached=reached(robot, body, targets, q, whole, standing.com_height),
        unbalanced=ground.unbalanced,
        notes=notes,
    )


class Solved(NamedTuple):
    """Configurations (n, nq), what they violate [m or rad], whether margins are kept for sure."""

    q: Array
    lacking: float
    apart: bool


def _solved(
    tasks: FrameTasks,
    legs: Legs,
    collision: SelfCollision | None,
    axes: Array,
    rounds: int,
    balance: bool,
    progress: Progress | None,
) -> Solved:
    """Return configurations as near to the targets as they come."""
    robot, wanted = tasks.robot, tasks.targets
    constraints = [] if collision is None else [collision]
    start = first_configuration(tasks, constraints)
    limits = Limits(robot, velocity=None)
    q = TickPass(tasks, limits, constraints).run(start, progress)
    motion = WholeMotion(tasks, collision, legs.length)
    states = motion.states(q)
    tasks.shape_like(states.inertia, axes)
    before, best, least = np.inf, q, np.inf
    for number in range(rounds):
        if number > 0:
            states = motion.states(q)
        if balance and number > 0:
            k = states.part("momentum", 6)[:, 3:]
            tasks.targets = balanced(tasks.targets, robot, k, states.com)
        further = motion.improved(q, states)
        if number == 0 and motion.violation > TRAPPED:  # legs that do not get past each other
            freely = TickPass(tasks, limits, ()).run(start, progress)
            trapped, q_further, by = q, further, motion.violation
            q, further = freely, motion.improved(freely)
            if motion.violation > by:
                q, further, motion.violation = trapped, q_further, by
        if motion.violation > max(WORSE * least, ASTRAY):  # it led astray: go on more carefully
            q, motion.damping = best, MORE * motion.damping
            continue
        if motion.violation < least:
            best, least = q, motion.violation
        last, q = q, further
        close = motion.off < CLOSE and motion.broken < GRAZED
        close = close and (motion.speed < 1.0 or motion.speed > 0.98 * before)
        before = motion.speed
        if number + 1 >= LEAST_ROUNDS and close and motion.moved < SETTLED:
            if collision is None:
                return Solved(q, motion.off, True)
            fine = apart(robot, q, collision, raw=number + 1 >= PATIENT)
            if fine.all():  # the last round may have hurried a joint again
                hurried = motion.speed <= 1.0 < _fastest(robot, q, wanted.dt)[0]
                return Solved(last if hurried else q, motion.off, not hurried)
            motion.keep_off(~fine)
        if motion.violation < ASTRAY and number + 1 < PATIENT:
            motion.damping = max(BOLDER * motion.damping, BOLDEST)
        elif motion.violation < ASTRAY:  # what is nearly right moves to and fro
            motion.damping = min(CALMER * motion.damping, CALMEST)
    motion.judge(q)
    if motion.violation >= least:
        return Solved(best, least, False)
    return Solved(q, motion.violation if motion.broken > GRAZED else motion.off, False)


def _fastest(robot: Robot, q: Array, dt: float) -> tuple[float, str]:
    """Return the largest speed of a joint by its limit, and which joint has it."""
    speed = np.abs(velocities(robot, q, dt)[:, BASE_NV:]).max(axis=0) / robot.limits.velocity
    joint = int(np.argmax(speed))
    return float(speed[joint]), robot.joint_names[joint]
