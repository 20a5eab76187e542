"""The floating base, found from a foot that stands flat on the ground."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
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
# m: the other foot is the lower one if it is so much below the planted foot's sole; less is noise.
HYSTERESIS = 0.005
EASE = 0.1  # s in which a foot that takes over comes to lie flat


@dataclass(frozen=True, eq=False)
class PlantedBase:
    """The base as a planted foot tells it."""

    base: Array  # position [m] and quaternion xyzw (n, 7)
    foot: NDArray[np.intp]  # which foot is planted (n,), index among robot.feet

    @property
    def changes(self) -> bool:
        """True if not one foot is planted all the time."""
        return bool((self.foot != self.foot[0]).any())


def planted_base(
    robot: Robot,
    time: Array,
    q: Array,
    planted: str,
    height: float = 0.0,
    progress: Progress | None = None,
) -> PlantedBase:
    """Return the base for which a foot's sole lies flat on the ground and does not move.

    In the first frame the base is above the origin and faces x. With ``auto`` the lower foot is
    planted. Another takes over, from the frame on in which it got lower, once it is 5 mm below the
    planted sole. The base does not jump then: the foot keeps the tilt and height that it has at
    this moment (what the recording's joints contradict the flat ground by) and loses them within
    0.1 s. It keeps its place and heading for good.

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

    Raises
    ------
    UnknownNameError
        The robot has no such foot, or none at all.
    """
    feet = tuple(robot.feet)
    if planted != AUTO or not feet:
        robot.foot(planted)
    still = q.copy()
    still[:, :7] = 0.0
    still[:, 6] = 1.0
    soles = sole_series(robot, still, progress)
    auto = planted == AUTO
    foot = _lower_feet(robot, soles) if auto else np.full(len(q), feet.index(planted))
    poses = _base_poses(np.stack([soles[name] for name in feet]), foot, time, height)
    quaternion = same_sign(Rotation.from_matrix(poses[:, :3, :3]).as_quat())
    return PlantedBase(np.hstack((poses[:, :3, 3], quaternion)), foot)


def _lower_feet(robot: Robot, soles: Mapping[str, Array]) -> NDArray[np.intp]:
    """Return the lower foot of each frame (n,), changing only where it is clearly another."""
    feet = tuple(robot.feet)
    count = len(soles[feet[0]])
    drop = np.full((len(feet), len(feet), count), np.inf)
    for a, planted in enumerate(feet):
        for b, other in enumerate(feet):
            if a != b:
                drop[a, b] = _height_above(soles[planted], soles[other], robot.feet[other].polygon)
    here = next((a for a in range(len(feet)) if (drop[a, :, 0] >= -HYSTERESIS).all()), 0)
    foot, start, sure = np.full(count, here), 0, -1
    while True:
        # Only later frames can revert a change, or two tilted feet would take turns for ever.
        clearly = np.flatnonzero(drop[here, :, sure + 1 :].min(axis=0) < -HYSTERESIS)
        if not len(clearly):
            return foot
        sure += 1 + int(clearly[0])
        lower = int(drop[here, :, sure].argmin())
        level = np.flatnonzero(drop[here, lower, start:sure] >= 0.0)
        start, here = (start + int(level[-1]) + 1 if len(level) else start), lower
        foot[start:] = here


def _height_above(planted: Array, other: Array, polygon: Array) -> Array:
    """Return how far the other sole's lowest corner is above the planted sole's plane (n,) [m]."""
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
            world = np.tile(_first_place(sole[0], height), (len(sole), 1, 1))
        else:
            # Where the foot is in the base's last frame so far is where it is kept.
            before = poses[first - 1] @ soles[foot[first], first - 1]
            world = _settling(before, time[first:end] - time[first - 1], height)
        poses[first:end] = world @ np.linalg.inv(sole)
    return poses


def _first_place(sole: Array, height: float) -> Array:
    """Return the pose (4, 4) of a flat sole for which the base is above the origin, facing x."""
    facing = sole[0, :3]  # the base's x axis in the sole's axes
    place = np.eye(4)
    place[:3, :3] = Rotation.from_euler("z", -np.arctan2(facing[1], facing[0])).as_matrix()
    base = place @ np.linalg.inv(sole)
    place[:3, 3] = -base[0, 3], -base[1, 3], height
    return place


def _settling(pose: Array, elapsed: Array, height: float) -> Array:
    """Return poses (n, 4, 4) that begin at ``pose`` and come to lie flat at its place."""
    heading = float(np.arctan2(pose[1, 0], pose[0, 0]))
    flat = np.eye(4)
    flat[:3, :3] = Rotation.from_euler("z", heading).as_matrix()
    flat[:3, 3] = pose[0, 3], pose[1, 3], height
    tilt = Rotation.from_matrix(flat[:3, :3].T @ pose[:3, :3]).as_rotvec()
    s = np.clip(elapsed / EASE, 0.0, 1.0)
    left = 1.0 - minimum_jerk(s)  # no jump in velocity and acceleration
    poses = np.tile(flat, (len(s), 1, 1))
    poses[:, :3, :3] = flat[:3, :3] @ Rotation.from_rotvec(left[:, None] * tilt).as_matrix()
    poses[:, 2, 3] += left * (pose[2, 3] - height)
    return poses
