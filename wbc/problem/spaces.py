"""What targets are made of, and the straight way from one to another.

A target is a vector, a rotation, a placement, a direction or a configuration. Each kind has a
difference, which is a vector, and a way to go a part of it; a ramp needs no more than that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from wbc.robot import Robot
from wbc.rotations import exp_rotation, log_rotation
from wbc.validate import Array


class Space(Protocol):
    """Where targets of one kind live: ``moved(start, difference(start, end)) == end``.

    Parts of a way add up: ``moved(moved(x, s w), t w) == moved(x, (s + t) w)``.
    """

    def difference(self, start: Array, end: Array) -> Array:
        """Return the way (k,) from one value to another."""
        ...

    def moved(self, start: Array, way: Array) -> Array:
        """Return the value at the end of a way."""
        ...


class Vectors:
    """Plain numbers."""

    def difference(self, start: Array, end: Array) -> Array:
        """Return ``end - start``."""
        return end - start

    def moved(self, start: Array, way: Array) -> Array:
        """Return ``start + way``."""
        return start + way


class Rotations:
    """Rotation matrices (3, 3); the way is a rotation vector in the rotating axes."""

    def difference(self, start: Array, end: Array) -> Array:
        """Return log(start' end) (3,) [rad]."""
        return log_rotation(start.T @ end)

    def moved(self, start: Array, way: Array) -> Array:
        """Return start exp(way)."""
        return start @ exp_rotation(way)


class Placements:
    """A rotation and a position side by side, (3, 4); the position moves on a straight line."""

    def difference(self, start: Array, end: Array) -> Array:
        """Return the difference of the positions [m] above the rotation vector [rad] (6,)."""
        turn = ROTATIONS.difference(start[:, :3], end[:, :3])
        return np.concatenate((end[:, 3] - start[:, 3], turn))

    def moved(self, start: Array, way: Array) -> Array:
        """Return the placement at the end of a way."""
        return placement(start[:, 3] + way[:3], ROTATIONS.moved(start[:, :3], way[3:]))


class Directions:
    """Unit vectors (3,), turned about the axis at right angles to both; world axes."""

    def difference(self, start: Array, end: Array) -> Array:
        """Return the rotation vector (3,) [rad] that turns one direction into another."""
        a, b = start / np.linalg.norm(start), end / np.linalg.norm(end)
        axis = np.cross(a, b)
        sine, cosine = float(np.linalg.norm(axis)), float(a @ b)
        if sine < 1e-9:  # the same or opposite: any axis at right angles will do for half a turn
            axis = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
            sine = 0.0
        return float(np.arctan2(sine, cosine)) * axis / np.linalg.norm(axis)

    def moved(self, start: Array, way: Array) -> Array:
        """Return the turned direction."""
        return exp_rotation(way) @ start


@dataclass(frozen=True, eq=False)
class Configurations:
    """Configurations (nq,) of a robot; continuous joints turn the shorter way."""

    robot: Robot

    def difference(self, start: Array, end: Array) -> Array:
        """Return the displacement (nv,)."""
        return self.robot.difference(start, end)

    def moved(self, start: Array, way: Array) -> Array:
        """Return the configuration at the end of a displacement."""
        return self.robot.integrate(start, way, 1.0)


VECTORS, ROTATIONS, PLACEMENTS, DIRECTIONS = Vectors(), Rotations(), Placements(), Directions()


def placement(position: Array, rotation: Array) -> Array:
    """Return a position (3,) and a rotation (3, 3) as one value (3, 4) of :class:`Placements`."""
    return np.column_stack((rotation, position))
