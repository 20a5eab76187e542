"""Frame after frame by the controller's tick: limits and margins hard, feet on the ground exact."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from wbc.constraints import Limits, SelfCollision
from wbc.constraints.rows import Constraint
from wbc.controllers.kinematic import KinematicController
from wbc.gait.legs import SIDES
from wbc.retargeting.tasks import FrameTasks
from wbc.robot import Robot
from wbc.robot.collision.raw_pairs import RawPairs
from wbc.robot.limits import BASE_NQ, BASE_NV
from wbc.robot.names import BASE
from wbc.robot.postures import STANDING
from wbc.robot.series import state_series, velocities
from wbc.rotations import rotation_from
from wbc.tasks import PoseTask, PostureTask
from wbc.validate import Array

Progress = Callable[[int, int], None]
# Steps that a robot is given to get from standing to the first frame, and how long each is.
GETTING_READY, READY_STEP = 400, 0.02
COARSE = 25.0  # Hz
REPORTED = 50  # frames from one call of ``progress`` to the next
THERE = 1e-5  # rad or m per step: it has arrived
LOST = 0.5  # rad or m: so far off what is wanted ticks do not come back
BROKEN = "margins, limits or speeds are broken, for it would be lost"
HELD = 100.0  # the same in the last pass
STANDS = 30.0  # weight of a foot on the ground by that of one in the air


def first_configuration(tasks: FrameTasks, constraints: Sequence[Constraint]) -> Array:
    """Return a configuration (nq,) for the first frame, by steps from standing."""
    robot, targets = tasks.robot, tasks.targets
    q = robot.postures[STANDING].copy()
    tasks.aim(0)
    q[:3] += targets.com[0] - robot.snapshot(q).com
    R = targets.rotation[tasks.body.pelvis][0] @ tasks.body.upright[tasks.body.pelvis].T
    q = _turned(robot, q, float(np.arctan2(R[1, 0], R[0, 0])))
    every = [*tasks.lasting, *tasks.feet.values()]
    controller = KinematicController(
        robot,
        every,
        contacts=(),
        limits=Limits(robot, velocity=None),
        constraints=constraints,
        dt=READY_STEP,
        damping=1e-4,
    )
    for task in every:
        task.gain = 0.2
    v = np.zeros(robot.nv)
    for _ in range(GETTING_READY):
        tick = controller.step(robot.snapshot(q, v))
        q = robot.integrate(q, tick.velocity, READY_STEP)
        if float(np.abs(tick.velocity).max()) * READY_STEP < THERE:
            break
    for task in every:
        task.gain = 0.1 if task is tasks.posture else 1.0
    return q


def _turned(robot: Robot, q: Array, yaw: float) -> Array:
    """Return a configuration turned about the vertical through its base."""
    v = np.zeros(robot.nv)
    R = robot.snapshot(q).rotation(BASE)
    v[3:6] = R.T @ [0.0, 0.0, yaw]
    return robot.integrate(q, v, 1.0)


class TickPass:
    """One pass over all frames.

    Attributes
    ----------
    failed:
        Frames in which a tick had no solution, and the robot was held.
    """

    def __init__(
        self, tasks: FrameTasks, limits: Limits | None, constraints: Sequence[Constraint]
    ) -> None:
        self.tasks, self.limits, self.constraints = tasks, limits, constraints
        self.failed = list[int]()

    def run(self, start: Array, progress: Progress | None = None) -> Array:
        """Return configurations (n, nq), the first of them ``start``.

        Some 25 frames a second are solved; those between are interpolated, for whoever has all of
        them at once.
        """
        tasks, targets, robot = self.tasks, self.tasks.targets, self.tasks.robot
        last, skipped = len(targets.time) - 1, max(1, round(1.0 / (COARSE * targets.dt)))
        frames = np.unique(np.append(np.arange(0, last, skipped), last))
        dt, count, down = skipped * targets.dt, len(frames), targets.down[frames]
        controller = KinematicController(
            robot,
            [*tasks.lasting, *tasks.feet.values()],
            contacts=(),
            limits=self.limits,
            constraints=self.constraints,
            dt=dt,
            damping=1e-5,
        )
        q = np.empty((count, robot.nq))
        q[0] = start
        v: Array = np.zeros(robot.nv)
        for k in range(1, count):
            tasks.aim(int(frames[k]))
            for n, side in enumerate(SIDES):
                if down[k, n] != down[k - 1, n] or k == 1:
                    tasks.feet[side].weight = tasks.foot_weight * (STANDS if down[k, n] else 1.0)
            tick = controller.step(robot.snapshot(q[k - 1], v))
            if not tick.ok:
                self.failed.append(int(frames[k]))
            v = tick.velocity
            q[k] = robot.integrate(q[k - 1], v, dt)
            if progress is not None and k % REPORTED == 0:
                progress(int(frames[k]), last)
        return self._between(q, frames)

    def _between(self, q: Array, frames: NDArray[np.intp]) -> Array:
        """Return configurations of all frames, on straight ways between those of some."""
        robot, found = self.tasks.robot, [q[0]]
        for a, b, way in zip(q[:-1], q[1:], np.diff(frames), strict=True):
            step = robot.difference(a, b)
            found += [robot.integrate(a, step, m / way) for m in range(1, way)]
            found.append(b)
        return np.array(found)


def kept(
    tasks: FrameTasks,
    wanted: Array,
    limits: Limits,
    collision: SelfCollision | None,
    progress: Progress | None = None,
    *,
    apart_already: bool = False,
) -> tuple[Array, dict[int, str]]:
    """Return configurations (n, nq) as near to ``wanted`` as limits and margins allow.

    Frames that keep them, margins by the shapes of the robot's files, are taken as they are; the
    tick makes what is nearest of others.

    Parameters
    ----------
    apart_already:
        Whether ``wanted`` is known to keep the margins.

    Returns
    -------
    tuple
        The configurations, and by frame what ticks that had no solution say.
    """
    robot, dt, down = tasks.robot, tasks.targets.dt, tasks.targets.down
    fine = _within(robot, wanted, limits, None if apart_already else collision)
    steps = velocities(robot, wanted, dt)
    if fine[1:].all() and (np.abs(steps[:, BASE_NV:]) <= limits.speed).all():
        return wanted.copy(), {}
    posture = PostureTask(robot, wanted[0], weight=1.0, gain=1.0)
    base = PoseTask(robot, BASE, wanted[0][:3], np.eye(3), weight=10.0, gain=1.0)
    controller = KinematicController(
        robot,
        [posture, base, *tasks.contacts.values()],
        contacts=(),
        limits=limits,
        constraints=[] if collision is None else [collision],
        dt=dt,
        damping=1e-6,
    )
    q, failed = wanted.copy(), dict[int, str]()
    v = steps[0]  # a motion that began before
    first, lost = 0, 0  # where ticks began, and before which frame they are of no use
    for k in range(1, len(wanted)):
        if progress is not None and k % REPORTED == 0:
            progress(k, len(wanted))
        there = robot.difference(q[k - 1], wanted[k]) / dt
        lost = k + 1 if lost == k and not fine[k] else lost
        if k < lost or (fine[k] and (np.abs(there[BASE_NV:]) <= limits.speed).all()):
            v, first = there, k + 1
            continue
        posture.set_target(wanted[k])
        base.set_target(wanted[k][:3], rotation_from(wanted[k][3:BASE_NQ]))
        tasks.aim_contacts(k)
        for n, side in enumerate(SIDES):  # not exact: a joint may be too slow for them
            tasks.contacts[side].weight = HELD * tasks.foot_weight if down[k, n] else 1.0
        tick = controller.step(robot.snapshot(q[k - 1], v))
        if not tick.ok:
            failed[k] = tick.report()
        v = tick.velocity
        q[k] = robot.integrate(q[k - 1], v, dt)
        if float(np.abs(robot.difference(q[k], wanted[k])).max()) > LOST:
            # A way through a body that it cannot go: what is wanted is taken, and what is broken.
            q[first : k + 1], lost = wanted[first : k + 1], k + 1
            failed[first] = f"{BROKEN} until {tasks.targets.time[k]:.2f} s at least"
    return q, failed


def _within(
    robot: Robot, q: Array, limits: Limits, collision: SelfCollision | None
) -> NDArray[np.bool_]:
    """Return which configurations keep limits and margins (n,)."""
    joints = np.array([robot.limits.joint_positions(one) for one in q])
    fine: NDArray[np.bool_] = np.asarray(
        ((joints >= limits.lower) & (joints <= limits.upper)).all(axis=1)
    )
    return fine if collision is None else fine & apart(robot, q, collision)


def apart(
    robot: Robot, q: Array, collision: SelfCollision, *, raw: bool = True
) -> NDArray[np.bool_]:
    """Return which configurations keep margins (n,), by the raw shapes where fitted ones do not.

    Raw shapes are read from the robot's files, which takes a second or more the first time. Where
    only the fitted ones break a margin, as of two hips that their joints hardly move apart,
    there is nothing to mend: to push them out would cost the feet.
    """
    states, native = state_series(robot, q), collision.model.native
    fine = np.ones(len(q), dtype=bool)
    if native is None or not raw:
        fine[collision.near(q, states, 0.0)[0]] = False
        return fine
    near, nearest = native.within(states.array, states.tree, 0.0, collision.kept())
    if not len(near):
        return fine
    unknown = near[nearest[:, 0] == -np.inf, 0]
    shapes = RawPairs(robot, collision.model.labels)
    for k in np.unique(near[:, 0]).tolist():
        pairs = near[near[:, 0] == k, 1].tolist()
        fine[k] = k not in unknown and shapes.apart(q[k], pairs, collision.margins)
    return fine
