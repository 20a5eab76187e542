"""From a recording to configurations, velocities and accelerations at even times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError
from wbc.motion.planted import planted_base
from wbc.motion.recording import Motion
from wbc.motion.smoothing import (
    even_grid,
    low_passed,
    on_grid,
    sampled,
    smooth_curve,
    turning,
)
from wbc.robot import Robot
from wbc.robot.limits import BASE_NQ, BASE_NV
from wbc.robot.series import Progress
from wbc.rotations import rotations_from, same_sign
from wbc.validate import Array, finite_number


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A smooth motion at even times.

    Attributes
    ----------
    time:
        (n,) [s].
    q, v, acceleration:
        Configurations (n, nq), velocities and their rates (n, nv); the base's in base axes.
    planted:
        Planted foot (n,), index among ``robot.feet``; None if the base was recorded.
    """

    time: Array
    q: Array
    v: Array
    acceleration: Array
    planted: NDArray[np.intp] | None


def smooth_trajectory(
    motion: Motion,
    rate: float | None,
    cutoff: float | None,
    planted: str | None,
    height: float,
    progress: Progress | None = None,
) -> Trajectory:
    """Return the trajectory of a recorded motion; see :func:`wbc.motion.analyse`."""
    if (motion.base is None) == (planted is None):
        raise InvalidInputError(
            f"{motion.source}: the base was not recorded; say which foot is planted: left, right or"
            " auto"
            if motion.base is None
            else f"{motion.source}: the base was recorded; leave planted out"
        )
    grid = even_grid(motion.time)
    own_rate = (len(grid) - 1) / float(grid[-1] - grid[0])
    rows = _unwrapped(motion)
    smooth = low_passed(on_grid(motion.time, rows, grid), own_rate, cutoff)
    foot = None
    if planted is not None:
        q = configurations(motion.robot, smooth)
        found = planted_base(motion.robot, grid, q, planted, height, progress)
        # Where feet take over the base turns a corner, which the joints' filter has not rounded.
        base = low_passed(found.base, own_rate, cutoff) if found.changes else found.base
        smooth, foot = np.hstack((base, smooth[:, BASE_NQ:])), found.foot
    smooth[:, 3:BASE_NQ] /= np.linalg.norm(smooth[:, 3:BASE_NQ], axis=1)[:, None]
    time = grid if rate is None else sampled(grid, finite_number("rate", rate, above=0.0))
    nearest = np.minimum(np.rint((time - grid[0]) * own_rate).astype(int), len(grid) - 1)
    q, v, acceleration = _read_off(motion.robot, grid, smooth, time)
    return Trajectory(time, q, v, acceleration, None if foot is None else foot[nearest])


def _unwrapped(motion: Motion) -> Array:
    """Return base (7) and joint angles in rows (n, nv+1) that do not jump."""
    joints = motion.joints.copy()
    for k in motion.robot.limits.unbounded:
        joints[:, k] = np.unwrap(joints[:, k])
    base = np.zeros((len(joints), BASE_NQ))
    base[:, 6] = 1.0
    if motion.base is not None:
        base[:] = motion.base
        base[:, 3:] = same_sign(base[:, 3:])
    return np.hstack((base, joints))


def configurations(robot: Robot, rows: Array) -> Array:
    """Return configurations q (n, nq) of rows (n, nv+1) of base and joint angles."""
    limits = robot.limits
    q = np.empty((len(rows), robot.nq))
    q[:, :BASE_NQ] = rows[:, :BASE_NQ]
    q[:, list(limits.starts)] = rows[:, BASE_NQ:]
    for k in limits.unbounded:
        start, angle = limits.starts[k], rows[:, BASE_NQ + k]
        q[:, start], q[:, start + 1] = np.cos(angle), np.sin(angle)
    return q


def _read_off(robot: Robot, grid: Array, rows: Array, time: Array) -> tuple[Array, Array, Array]:
    """Return q, v and the rate of v at some times, by the spline through rows (m, nv+1)."""
    curve = smooth_curve(grid, rows)
    values, first, second = (curve(time, order) for order in range(3))
    quaternion = values[:, 3:BASE_NQ]
    spin, spin_rate = turning(quaternion, first[:, 3:BASE_NQ], second[:, 3:BASE_NQ])
    values[:, 3:BASE_NQ] = quaternion / np.linalg.norm(quaternion, axis=1)[:, None]
    inward = np.swapaxes(rotations_from(values[:, 3:BASE_NQ]), 1, 2)  # from world to base axes
    v, acceleration = np.empty((len(time), robot.nv)), np.empty((len(time), robot.nv))
    v[:, :3] = (inward @ first[:, :3, None])[..., 0]
    v[:, 3:6], v[:, BASE_NV:] = spin, first[:, BASE_NQ:]
    # The axes turn with the base, hence the second term.
    acceleration[:, :3] = (inward @ second[:, :3, None])[..., 0] - np.cross(spin, v[:, :3])
    acceleration[:, 3:6], acceleration[:, BASE_NV:] = spin_rate, second[:, BASE_NQ:]
    return configurations(robot, values), v, acceleration
