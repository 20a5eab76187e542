"""Shapes, bodies and obstacles: convex cores with a rounding radius."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wbc.attributes import DeclaredAttributes
from wbc.errors import InvalidInputError, shown
from wbc.kinds import check_word
from wbc.robot.formats.triangles import BOX_CORNERS
from wbc.rotations import check_rotation, exp_rotation
from wbc.validate import Array, finite_array, finite_number, read_only, set_fields

_ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Capsule:
    """All points within ``radius`` of a segment; a sphere where both ends are one point."""

    ends: Array  # (2, 3) [m]
    radius: float  # [m], not negative

    @classmethod
    def of(cls, start: ArrayLike, end: ArrayLike, radius: float) -> Capsule:
        """Return a checked capsule."""
        ends = [finite_array(f"capsule, {name}", point, (3,))
                for name, point in (("start", start), ("end", end))]  # fmt: skip
        return cls(np.stack(ends), finite_number("capsule, radius", radius, least=0.0))

    @classmethod
    def sphere(cls, centre: ArrayLike, radius: float) -> Capsule:
        """Return a checked sphere."""
        point = finite_array("sphere, centre", centre, (3,))
        return cls.of(point, point, finite_number("sphere, radius", radius, least=0.0))

    def __post_init__(self) -> None:
        read_only(self.ends)

    @property
    def core(self) -> Array:
        """Points (2, 3) whose convex hull, rounded by ``radius``, is the shape."""
        return self.ends


@dataclass(frozen=True, eq=False)
class Hull:
    """All points within ``radius`` of the convex hull of ``vertices``; a box has 8 of them."""

    vertices: Array  # (k, 3) [m], each a corner of the hull, not all in one plane
    radius: float = 0.0  # [m], not negative; 0 for a plain polytope

    @classmethod
    def box(cls, size: ArrayLike, centre: ArrayLike = _ZERO) -> Hull:
        """Return a box with side lengths ``size`` (3,) along the axes."""
        sides = finite_array("box, size", size, (3,))
        if (sides <= 0.0).any():
            raise InvalidInputError(f"box, size: sides must be positive, got {sides.tolist()}")
        return cls(0.5 * sides * BOX_CORNERS + finite_array("box, centre", centre, (3,)))

    def __post_init__(self) -> None:
        read_only(self.vertices)

    @property
    def core(self) -> Array:
        """Points (k, 3) whose convex hull, rounded by ``radius``, is the shape."""
        return self.vertices


@dataclass(frozen=True, eq=False)
class HalfSpace:
    """All points x with ``normal . x <= offset``: a floor, a wall, an infinite table."""

    normal: Array  # (3,) unit vector that points out of it
    offset: float  # of its surface along the normal [m]

    @classmethod
    def of(cls, normal: ArrayLike, offset: float) -> HalfSpace:
        """Return a checked half-space; ``normal`` need not be of unit length."""
        n = finite_array("half-space, normal", normal, (3,))
        size = float(np.linalg.norm(n))
        if size < 1e-9:
            raise InvalidInputError("half-space, normal: must not be zero")
        return cls(n / size, finite_number("half-space, offset", offset))

    def __post_init__(self) -> None:
        read_only(self.normal)

    @property
    def core(self) -> Array:
        """One point (1, 3) of its surface."""
        return self.offset * self.normal[None]

    @property
    def radius(self) -> float:
        """Nothing is rounded."""
        return 0.0


Solid = Capsule | Hull  # what a robot is made of
Shape = Solid | HalfSpace


def moved(shape: Solid, rotation: Array, origin: Array) -> Solid:
    """Return the shape turned by ``rotation`` (3, 3), then shifted by ``origin`` (3,)."""
    core = shape.core @ rotation.T + origin
    if isinstance(shape, Capsule):
        return Capsule(core, shape.radius)
    return Hull(core, shape.radius)


@dataclass(frozen=True, eq=False)
class Body:
    """One shape on one link."""

    name: str  # for labels: the link's, numbered where the link has several shapes
    link: str  # the link that carries it
    # Pinocchio's index of the joint that moves it; 0 for bodies not attached to the robot.
    joint: int
    shape: Shape  # in that joint's frame
    bulge: float = 0.0  # how far the shape may exceed the one it represents [m]

    @property
    def bounding_ball(self) -> tuple[Array, float]:
        """Centre (3,) in the joint's frame and radius [m] of a ball that holds the shape."""
        core = self.shape.core
        centre = 0.5 * (core.min(axis=0) + core.max(axis=0))
        reach = float(np.linalg.norm(core - centre, axis=1).max())
        return centre, reach + self.shape.radius

    @property
    def length(self) -> float:
        """Length of the core [m]: of a capsule exactly, of a hull at most; infinite in a plane."""
        core = self.shape.core
        match self.shape:
            case Capsule():
                return float(np.linalg.norm(core[1] - core[0]))
            case Hull():
                return float(np.linalg.norm(core.max(axis=0) - core.min(axis=0)))
        return np.inf


class Obstacle(DeclaredAttributes):
    """Something that is not part of the robot, with a pose and a velocity.

    It is moved by :meth:`move`, or by its attributes.

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
    velocity, angular_velocity:
        Of its frame's origin (3,) [m/s] and of its frame (3,) [rad/s]; world axes.

    Raises
    ------
    InvalidInputError
        No name, or no shape.
    """

    name: str
    shape: Shape
    rotation: Array
    origin: Array
    velocity: Array
    angular_velocity: Array

    _fixed = dict.fromkeys(("name", "shape"), "make another Obstacle")
    _MOVING = ("rotation", "origin", "velocity", "angular_velocity")

    def __init__(self, name: str, shape: Shape) -> None:
        check_word("obstacle, name", name)
        if not isinstance(shape, Shape):
            raise InvalidInputError(
                f"obstacle {name!r}: expected a shape, such as Capsule.of(...), got {shown(shape)};"
                " Obstacle.sphere() and others make both"
            )
        self.name, self.shape = name, shape
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
        angular_velocity: ArrayLike = _ZERO,
    ) -> None:
        """Set the pose and velocity of the obstacle's frame.

        Raises
        ------
        InvalidInputError
            Not finite, of another size, or no rotation.
        """
        given = zip(self._MOVING, (rotation, origin, velocity, angular_velocity), strict=True)
        set_fields(self, **{name: self._checked(name, value) for name, value in given})

    def _set_attribute(self, name: str, value: object) -> None:
        moving = name in self._MOVING
        super()._set_attribute(name, self._checked(name, value) if moving else value)

    def _checked(self, name: str, value: Any) -> Array:
        what = f"obstacle {self.name!r}, {name.replace('_', ' ')}"
        found = finite_array(what, value, (3, 3) if name == "rotation" else (3,))
        if name == "rotation":
            check_rotation(what, found)
        return read_only(found)

    def advance(self, dt: float) -> None:
        """Move on by ``dt`` [s] at the present velocities."""
        dt = finite_number(f"obstacle {self.name!r}, dt", dt)
        self.move(
            exp_rotation(dt * self.angular_velocity) @ self.rotation,
            self.origin + dt * self.velocity,
            self.velocity,
            self.angular_velocity,
        )
