"""The floating base, from a foot that stands flat on the ground."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from wbc.minimum_jerk import minimum_jerk
from wbc.robot import Robot
from wbc.robot.series import Progress, sole_series
from wbc.rotations import same_sign
from wbc.validate import Array

AUTO = "auto"
HYSTERESIS = 0.005  # m, of the other foot below the planted sole before it is planted instead
EASE = 0.1  # s in which a newly planted foot becomes flat


def planted_base(
    robot: Robot,
    time: Array,
    q: Array,
    planted: str,
    height: float = 0.0,
    progress: Progress | None = None,
) -> tuple[Array, NDArray[np.intp]]:
    """Return the base for which a foot's sole lies flat on the ground and does not move.

    In the first frame the base is above the origin and faces x. With ``auto`` the lower foot is
    planted: once another is 5 mm below the planted sole, it is planted from the frame on in which
    it became the lower one. The base does not jump then: the foot keeps its place and heading, and
    its tilt and height, by which the recorded joints contradict flat ground, fade within 0.1 s.

    Parameters
    ----------
    time:
        Times (n,) [s].
    q:
        Configurations (n, nq); only the joints are used.
    planted:
        A foot, or ``auto``.
    height:
        Height of the ground [m].

    Returns
    -------
    tuple
        Positions [m] and quaternions xyzw (n, 7), and the planted foot (n,), index among
        ``robot.feet``.

    Raises
    ------
    UnknownNameError
        The robot has no such foot, or none at all.
    """
    feet = tuple(robot.feet)
    if planted != AUTO or not feet:
        robot.foot(planted)
    fixed_base = q.copy()
    fixed_base[:, :7] = 0.0
    fixed_base[:, 6] = 1.0
    soles = sole_series(robot, fixed_base, progress)
    auto = planted == AUTO
    foot = _lower_feet(robot, soles) if auto else np.full(len(q), feet.index(planted))
    poses = _base_poses(np.stack([soles[name] for name in feet]), foot, time, height)
    quaternion = same_sign(Rotation.from_matrix(poses[:, :3, :3]).as_quat())
    return np.hstack((poses[:, :3, 3], quaternion)), foot


def _lower_feet(robot: Robot, soles: Mapping[str, Array]) -> NDArray[np.intp]:
    """Return the lower foot of each frame (n,), with hysteresis."""
    feet = tuple(robot.feet)
    count = len(soles[feet[0]])
    drop = np.full((len(feet), len(feet), count), np.inf)
    for a, planted in enumerate(feet):
        for b, other in enumerate(feet):
            if a != b:
                drop[a, b] = _height_above(soles[planted], soles[other], robot.feet[other].polygon)
    current = next((a for a in range(len(feet)) if (drop[a, :, 0] >= -HYSTERESIS).all()), 0)
    foot, start, frame = np.full(count, current), 0, -1
    while True:
        # Only later frames can revert a change, or two tilted feet would alternate for ever.
        lower_frames = np.flatnonzero(drop[current, :, frame + 1 :].min(axis=0) < -HYSTERESIS)
        if not len(lower_frames):
            return foot
        frame += 1 + int(lower_frames[0])
        lower = int(drop[current, :, frame].argmin())
        higher = np.flatnonzero(drop[current, lower, start:frame] >= 0.0)
        start, current = (start + int(higher[-1]) + 1 if len(higher) else start), lower
        foot[start:] = current


def _height_above(planted: Array, other: Array, polygon: Array) -> Array:
    """Return the height of the other sole's lowest corner above the planted sole (n,) [m]."""
    relative = np.linalg.inv(planted) @ other
    corners = relative[:, 2, :2] @ polygon.T + relative[:, 2, 3:]  # (n, k)
    return np.asarray(corners.min(axis=1))


def _base_poses(soles: Array, foot: NDArray[np.intp], time: Array, height: float) -> Array:
    """Return base poses (n, 4, 4), given soles in base axes (f, n, 4, 4) and the planted foot."""
    poses = np.empty((len(foot), 4, 4))
    starts = [0, *(np.flatnonzero(np.diff(foot)) + 1).tolist(), len(foot)]
    for first, end in pairwise(starts):
        sole = soles[foot[first], first:end]
        if first == 0:
            world = np.tile(_first_sole_pose(sole[0], height), (len(sole), 1, 1))
        else:
            # The foot is planted where it is in the frame before.
            before = poses[first - 1] @ soles[foot[first], first - 1]
            world = _flattened(before, time[first:end] - time[first - 1], height)
        poses[first:end] = world @ np.linalg.inv(sole)
    return poses


def _first_sole_pose(sole: Array, height: float) -> Array:
    """Return the pose (4, 4) of a flat sole for which the base is above the origin, facing x."""
    forward = sole[0, :3]  # the base's x axis in the sole's axes
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", -np.arctan2(forward[1], forward[0])).as_matrix()
    base = pose @ np.linalg.inv(sole)
    pose[:3, 3] = -base[0, 3], -base[1, 3], height
    return pose


def _flattened(pose: Array, elapsed: Array, height: float) -> Array:
    """Return poses (n, 4, 4) that begin at ``pose`` and become flat at its place."""
    heading = float(np.arctan2(pose[1, 0], pose[0, 0]))
    flat = np.eye(4)
    flat[:3, :3] = Rotation.from_euler("z", heading).as_matrix()
    flat[:3, 3] = pose[0, 3], pose[1, 3], height
    tilt = Rotation.from_matrix(flat[:3, :3].T @ pose[:3, :3]).as_rotvec()
    s = np.clip(elapsed / EASE, 0.0, 1.0)
    remaining = 1.0 - minimum_jerk(s)  # no jump in velocity and acceleration
    poses = np.tile(flat, (len(s), 1, 1))
    poses[:, :3, :3] = flat[:3, :3] @ Rotation.from_rotvec(remaining[:, None] * tilt).as_matrix()
    poses[:, 2, 3] += remaining * (pose[2, 3] - height)
    return poses
