"""Forward kinematics of a human in many frames at once, with Jacobians.

Pinocchio evaluates one frame at a time; a fit to markers needs thousands at once, and derivatives
by the body's dimensions, which Pinocchio does not have. Tests compare both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.human.body import HINGES, SEGMENTS, origin_maps
from wbc.spatial import skews
from wbc.validate import Array

ORIGIN_MAPS = origin_maps()
# Whether the second segment moves with the first, or is it (segments, segments).
IN_SUBTREE = np.eye(len(SEGMENTS), dtype=bool)
for _k, _segment in enumerate(SEGMENTS[1:], 1):
    IN_SUBTREE[:, _k] |= IN_SUBTREE[:, _segment.parent]
HINGE_SEGMENTS = np.array([k for k, s in enumerate(SEGMENTS) for _ in s.hinges])
HINGE_AXES = np.array([hinge.axis for hinge in HINGES])  # (h, 3), unit vectors
_CROSS = skews(HINGE_AXES)
_CROSS_TWICE = _CROSS @ _CROSS
BASE_DOFS = 6
DOFS = BASE_DOFS + len(HINGES)


@dataclass(frozen=True, eq=False)
class Poses:
    """Postures of a human in n frames."""

    position: Array  # of the pelvis (n, 3) [m]
    rotation: Array  # of the pelvis (n, 3, 3)
    angles: Array  # of the hinges (n, 34) [rad]

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, frames: slice | NDArray[np.intp]) -> Poses:
        return Poses(*(one[frames] for one in vars(self).values()))

    def copy(self) -> Poses:
        """Return a writable copy."""
        return Poses(*(one.copy() for one in vars(self).values()))

    def put(self, frames: int | NDArray[np.intp], other: Poses, rows: Any) -> None:
        """Set some frames to rows of others."""
        for name, one in vars(self).items():
            one[frames] = getattr(other, name)[rows]

    def step(self, step: Array) -> Poses:
        """Return the postures after steps (n, 40): of the pelvis in world axes, then of hinges."""
        R = rotations(step[:, 3:6]) @ self.rotation
        return Poses(self.position + step[:, :3], R, self.angles + step[:, 6:])


@dataclass(frozen=True, eq=False)
class SegmentFrames:
    """Poses of the segments and axes of the hinges in n frames, in world axes."""

    rotation: Array  # of the segments (n, s, 3, 3)
    origin: Array  # of the segments (n, s, 3) [m]
    axis: Array  # of the hinges (n, h, 3)


def rotations(vectors: Array) -> Array:
    """Return the rotation matrices (n, 3, 3) of rotation vectors (n, 3) [rad], by Rodrigues."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    K = skews(vectors)
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2  # (1 - cos t) / t^2
    return np.asarray(np.eye(3) + first * K + second * (K @ K))


def hinge_rotations(angles: Array) -> Array:
    """Return the rotation matrices (n, h, 3, 3) of the hinges at angles (n, h) [rad]."""
    angle = angles[:, :, None, None]
    return np.asarray(np.eye(3) + np.sin(angle) * _CROSS + (1.0 - np.cos(angle)) * _CROSS_TWICE)


def forward_kinematics(poses: Poses, dimensions: Array) -> SegmentFrames:
    """Return the poses of the segments of a body with dimensions (12,) [m]."""
    count = len(poses)
    offsets = ORIGIN_MAPS @ dimensions
    rotation = np.empty((count, len(SEGMENTS), 3, 3))
    origin, axis = np.empty((count, len(SEGMENTS), 3)), np.empty((count, len(HINGES), 3))
    rotation[:, 0], origin[:, 0] = poses.rotation, poses.position
    turns, number = hinge_rotations(poses.angles), 0
    for k, segment in enumerate(SEGMENTS[1:], 1):
        R = rotation[:, segment.parent]
        origin[:, k] = origin[:, segment.parent] + R @ offsets[k]
        for _ in segment.hinges:
            axis[:, number] = R @ HINGE_AXES[number]
            R = R @ turns[:, number]
            number += 1
        rotation[:, k] = R
    return SegmentFrames(rotation, origin, axis)


def point_jacobian(frames: SegmentFrames, segments: NDArray[np.intp], points: Array) -> Array:
    """Return the Jacobian (n, m, 3, 40) of points (n, m, 3) on segments (m,) by steps."""
    count, many = points.shape[:2]
    J = np.zeros((count, many, 3, DOFS))
    J[..., :3] = np.eye(3)
    from_pelvis = (points - frames.origin[:, None, 0]).reshape(-1, 3)
    J[..., 3:6] = -skews(from_pelvis).reshape(count, many, 3, 3)
    arms = points[:, :, None] - frames.origin[:, None, HINGE_SEGMENTS]  # (n, m, h, 3)
    columns = np.cross(frames.axis[:, None], arms)
    columns *= IN_SUBTREE[HINGE_SEGMENTS][:, segments].T[None, :, :, None]
    J[..., 6:] = np.swapaxes(columns, 2, 3)
    return J


def dimension_jacobian(frames: SegmentFrames, segments: NDArray[np.intp]) -> Array:
    """Return the Jacobian (n, m, 3, 12) of points on segments (m,) by the dimensions."""
    J = np.zeros((len(frames.origin), len(SEGMENTS), 3, ORIGIN_MAPS.shape[2]))
    for k, segment in enumerate(SEGMENTS[1:], 1):
        J[:, k] = J[:, segment.parent] + frames.rotation[:, segment.parent] @ ORIGIN_MAPS[k]
    return np.asarray(J[:, segments])
