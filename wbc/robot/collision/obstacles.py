"""Things around the robot: spheres, capsules, boxes and half-spaces, at rest or moving."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.robot.collision.shapes import Capsule, HalfSpace, Hull, Shape
from wbc.rotations import exp_rotation
from wbc.validate import finite_array, read_only

_ZERO = (0.0, 0.0, 0.0)


class Obstacle:
    """Something that the robot does not carry, with a place and a velocity.

    Parameters
    ----------
    name:
        For labels.
    shape:
        In the obstacle's own frame, which is the world's until it is moved.

    Attributes
    ----------
    rotation, origin:
        Place of its frame: (3, 3) and (3,) [m].
    velocity, spin:
        Of its frame's origin (3,) [m/s], and its angular velocity (3,) [rad/s]; world axes.
    """

    def __init__(self, name: str, shape: Shape) -> None:
        self.name = name
        self.shape = shape
        self.move(np.eye(3), _ZERO)

    def __repr__(self) -> str:
        return f"Obstacle({self.name!r}, {type(self.shape).__name__})"

    @classmethod
    def sphere(cls, name: str, centre: ArrayLike, radius: float) -> Obstacle:
        """Return a sphere."""
        return cls(name, Capsule.sphere(centre, radius))

    @classmethod
    def capsule(cls, name: str, start: ArrayLike, end: ArrayLike, radius: float) -> Obstacle:
        """Return all points within ``radius`` of the segment from ``start`` to ``end``."""
        return cls(name, Capsule.of(start, end, radius))

    @classmethod
    def box(cls, name: str, size: ArrayLike, centre: ArrayLike = _ZERO) -> Obstacle:
        """Return a box with sides ``size`` along the axes of its frame."""
        return cls(name, Hull.box(size, centre))

    @classmethod
    def half_space(cls, name: str, normal: ArrayLike, offset: float) -> Obstacle:
        """Return all points x with ``normal . x <= offset``."""
        return cls(name, HalfSpace.of(normal, offset))

    def move(
        self,
        rotation: ArrayLike,
        origin: ArrayLike,
        velocity: ArrayLike = _ZERO,
        spin: ArrayLike = _ZERO,
    ) -> None:
        """Put the obstacle's frame somewhere, and say how it moves from there.

        Raises
        ------
        InvalidInputError
            Not finite, of another size, or no rotation.
        """
        what = f"obstacle {self.name!r}"
        R = finite_array(f"{what}, rotation", rotation, (3, 3))
        if np.abs(R @ R.T - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0.0:
            raise InvalidInputError(f"{what}, rotation: not a rotation matrix")
        place = finite_array(f"{what}, origin", origin, (3,))
        rates = (
            finite_array(f"{what}, velocity", velocity, (3,)),
            finite_array(f"{what}, spin", spin, (3,)),
        )
        self.rotation, self.origin = read_only(R), read_only(place)
        self.velocity, self.spin = (read_only(rate) for rate in rates)

    def advance(self, dt: float) -> None:
        """Move on by ``dt`` at the present velocity and spin."""
        self.move(
            exp_rotation(dt * self.spin) @ self.rotation,
            self.origin + dt * self.velocity,
            self.velocity,
            self.spin,
        )
