"""Frames mounted on links, such as IMUs and soles: poses in the base by joint positions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wbc.kinds import check_word
from wbc.native import doubles, integers, lib
from wbc.robot.limits import BASE_NQ
from wbc.robot.model import Robot
from wbc.rotations import check_rotation
from wbc.validate import Array, Index, finite_array, read_only


class Mount(NamedTuple):
    """Where something is mounted on a robot."""

    frame: str  # a link or frame
    position: Array  # (3,) [m], in the frame's axes from its origin
    rotation: Array  # (3, 3) taking its axes to the frame's


class MountedFrames:
    """Poses and Jacobians of mounted frames in the base's axes, in its own memory.

    ``frames``: (k, 12 + 6 nv), as :func:`update` left them: origin, rotation (3, 3), Jacobian (6,
    nv).
    """

    def __init__(self, robot: Robot, mounts: Sequence[Mount]) -> None:
        self.robot, self._mounts = robot, tuple(mounts)
        tree = robot.native.tree
        self._tree, self._count = tree, len(mounts)
        self._joints, self._placements = mounted_places(robot, mounts)
        self._q, self._v = np.zeros(robot.nq), np.zeros(robot.nv)
        self._q[BASE_NQ - 1] = 1.0
        self._state = np.zeros(tree.frames)
        self._scratch = np.zeros(13 * tree.joints + 17 * tree.nv)
        self.frames = np.zeros((len(mounts), tree.frame_size))

    def __reduce__(self) -> tuple[Any, ...]:
        """Return constructor, arguments and frames: the core's struct cannot be pickled."""
        return type(self), (self.robot, self._mounts), self.frames

    def __setstate__(self, frames: Array) -> None:
        self.frames[:] = frames

    def update(self, positions: Array) -> None:
        """Compute them at joint positions (nv-6,) [rad or m], the base at the origin, upright."""
        self.robot.limits.write_positions(self._q, positions)
        state, tree = doubles(self._state), self._tree.struct
        lib.wbc_state(
            tree,
            *(doubles(self._q), doubles(self._v), state, doubles(self._scratch), 0),
            *(integers(self._joints), doubles(self._placements)),
        )
        lib.wbc_frames(
            tree,
            *(state, self._count, integers(self._joints), doubles(self._placements)),
            doubles(self.frames),
        )

    def origin(self, k: int) -> Array:
        """Return a view of the origin (3,) of one [m]."""
        return self.frames[k, :3]

    def rotation(self, k: int) -> Array:
        """Return a view of the rotation (3, 3) of one."""
        return self.frames[k, 3:12].reshape(3, 3)

    def jacobian(self, k: int) -> Array:
        """Return a view of the Jacobian (6, nv) of one's origin, base axes."""
        return self.frames[k, 12:].reshape(6, -1)


def mounted_places(robot: Robot, mounts: Sequence[Mount]) -> tuple[Index, Array]:
    """Return the joint (k,) that carries each mount, and its rotation and origin (k, 12) there."""
    frames = [robot.frame(mount.frame) for mount in mounts]
    joints = np.array([frame.parentJoint for frame in frames], dtype=np.int64)
    placements = np.zeros((len(mounts), 12))
    for row, frame, mount in zip(placements, frames, mounts, strict=True):
        R = np.array(frame.placement.rotation)
        row[:9] = (R @ mount.rotation).ravel()
        row[9:] = np.array(frame.placement.translation) + R @ mount.position
    return joints, placements


def mount(what: str, frame: str, position: ArrayLike, rotation: ArrayLike) -> Mount:
    """Return a checked mount; ``what`` begins the messages.

    Raises InvalidInputError: no name, NaN, another shape, or no rotation.
    """
    check_word(f"{what}, frame", frame)
    p = finite_array(f"{what}, position", position, (3,))
    R = finite_array(f"{what}, rotation", rotation, (3, 3))
    check_rotation(f"{what}, rotation", R)
    return Mount(frame, read_only(p), read_only(R))
