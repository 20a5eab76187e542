"""The initial guess: frame by frame by the controller's tick, with hard limits and margins."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from wbc.constraints import Limits
from wbc.constraints.rows import Constraint
from wbc.controllers.kinematic import KinematicController
from wbc.gait.crouch import walking_posture
from wbc.gait.legs import SIDES
from wbc.retargeting.tasks import FrameTasks
from wbc.robot import Robot
from wbc.robot.names import BASE
from wbc.robot.postures import STANDING
from wbc.robot.series import velocities
from wbc.validate import Array

Progress = Callable[[int, int], None]
FIRST_FRAME_STEPS, FIRST_FRAME_DT = 400, 0.02  # from standing to the first frame, at most; s
COARSE_RATE = 16.0  # Hz
FRAMES_PER_REPORT = 50  # from one call of ``progress`` to the next
CONVERGED_STEP = 1e-5  # rad or m
# Ticks per coarse frame at most, and the step that ends them. With one an arm that is raised by
# 100 degrees within 0.4 s stays below: where legs are straight, rows of first order do not see that
# they can lower the CoM.
TICKS_PER_FRAME, SMALL_STEP = 8, 1e-2  # 1, rad or m
CONTACT_WEIGHT_FACTOR = 30.0  # weight of a foot on the ground by that of one in the air


def first_configuration(tasks: FrameTasks, constraints: Sequence[Constraint]) -> Array:
    """Return a configuration (nq,) for the first frame, by steps from standing.

    Knees are bent first: straight ones may bend either way, and the trunk would lean back instead.
    """
    robot, targets = tasks.robot, tasks.targets
    standing, height = robot.snapshot(robot.postures[STANDING]), float(targets.com[0, 2])
    q = walking_posture(standing, height, tasks.legs).copy()
    tasks.set_targets(0)
    q[:3] += targets.com[0] - robot.snapshot(q).com
    R = targets.rotation[tasks.body.pelvis][0] @ tasks.body.upright[tasks.body.pelvis].T
    turn = np.zeros(robot.nv)  # about the vertical through the base
    turn[3:6] = robot.snapshot(q).rotation(BASE).T @ [0.0, 0.0, np.arctan2(R[1, 0], R[0, 0])]
    q = robot.integrate(q, turn, 1.0)
    every = [*tasks.configuration_tasks, *tasks.feet.values()]
    controller = _controller(tasks, constraints, FIRST_FRAME_DT, 1e-4)
    for task in every:
        task.gain = 0.2
    v = np.zeros(robot.nv)
    for _ in range(FIRST_FRAME_STEPS):
        tick = controller.step(robot.snapshot(q, v))
        q = robot.integrate(q, tick.velocity, FIRST_FRAME_DT)
        if float(np.abs(tick.velocity).max()) * FIRST_FRAME_DT < CONVERGED_STEP:
            break
    for task in every:
        task.gain = 1.0
    return q


def _controller(
    tasks: FrameTasks, constraints: Sequence[Constraint], dt: float, damping: float
) -> KinematicController:
    """Return a controller of all tasks, with limits of positions but not of speeds."""
    return KinematicController(
        tasks.robot,
        [*tasks.configuration_tasks, *tasks.feet.values()],
        contacts=(),
        limits=Limits(tasks.robot, velocity=None),
        constraints=constraints,
        dt=dt,
        damping=damping,
        solver="active_set",
    )


def solve_frames(
    tasks: FrameTasks,
    start: Array,
    constraints: Sequence[Constraint],
    progress: Progress | None = None,
) -> Array:
    """Return configurations (n, nq) of all frames, the first of them ``start``.

    Some 16 frames a second are solved and the others interpolated, which does for an initial guess.
    Where a tick has no solution, the robot is held.
    """
    targets, robot = tasks.targets, tasks.robot
    last, stride = len(targets.time) - 1, max(1, round(1.0 / (COARSE_RATE * targets.dt)))
    frames = np.unique(np.append(np.arange(0, last, stride), last))
    dt, count, down = stride * targets.dt, len(frames), targets.down[frames]
    controller = _controller(tasks, constraints, dt, 1e-5)
    q = np.empty((count, robot.nq))
    q[0] = start
    v: Array = np.zeros(robot.nv)
    for k in range(1, count):
        tasks.set_targets(int(frames[k]))
        for n, side in enumerate(SIDES):
            if down[k, n] != down[k - 1, n] or k == 1:
                factor = CONTACT_WEIGHT_FACTOR if down[k, n] else 1.0
                tasks.feet[side].weight = tasks.foot_weight * factor
        q[k] = q[k - 1]
        for _ in range(TICKS_PER_FRAME):
            v = controller.step(robot.snapshot(q[k], v)).velocity
            q[k] = robot.integrate(q[k], v, dt)
            if float(np.abs(v).max()) * dt < SMALL_STEP:
                break
        if progress is not None and k % FRAMES_PER_REPORT == 0:
            progress(int(frames[k]), last)
    return interpolate(robot, q, np.interp(np.arange(last + 1), frames, np.arange(count)))


def interpolate(robot: Robot, q: Array, places: Array) -> Array:
    """Interpolate configurations (n, nq) geodesically at fractional indices (m,)."""
    first = np.minimum(places.astype(int), len(q) - 2)
    steps = velocities(robot, q, 1.0)[first] * (places - first)[:, None]
    return robot.integrate_all(q[first], steps)
