"""Balls and capsules round bodies: bounds from below on the distances of many pairs at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from wbc.robot.collision.fitting import quick_capsule
from wbc.robot.collision.shapes import Body, Capsule, HalfSpace, Hull, Shape
from wbc.validate import Array

Index = NDArray[np.int64]
Scalar = TypeVar("Scalar", bound=np.generic)


class Covers:
    """A ball and a capsule round each body; that of a capsule is itself.

    Of a half-space, the ball is a point of its surface, and nothing else is round it.

    Attributes
    ----------
    local:
        (bodies, 3, 3) start, unit direction and middle of each, in columns, in its joint's axes.
    sizes:
        (bodies, 3) length and radius of the capsule, radius of the ball [m].
    """

    def __init__(self, bodies: Sequence[Body]) -> None:
        covers = [_cover(body.shape) for body in bodies]
        self._own = [_columns(*both) for both in zip(bodies, covers, strict=True)]
        self.local = np.stack(self._own)
        radii = np.array([cover.radius for cover in covers])
        lengths = np.array([_length(cover) for cover in covers])
        reach = np.array([body.bounding_ball[1] for body in bodies])
        self.sizes = np.column_stack((lengths, radii, reach))

    def place(self, body: int, rotation: Array, origin: Array) -> None:
        """Move a body of joint 0: its frame is put at ``rotation``, ``origin`` (world)."""
        self.local[body] = rotation @ self._own[body]
        self.local[body, :, 0] += origin
        self.local[body, :, 2] += origin


def chosen_of(values: NDArray[Scalar], chosen: Index | None) -> NDArray[Scalar]:
    """Return what belongs to the chosen pairs; if these are all (None), without a copy."""
    return values if chosen is None else values.take(chosen, axis=0)


def smallest(values: Array, count: int) -> float:
    """Return the ``count``-th of the smallest values."""
    return float(np.partition(values, count - 1)[count - 1])


def _cover(shape: Shape) -> Capsule:
    """Return a capsule that holds a shape; of a half-space, a point of its surface."""
    match shape:
        case Capsule():
            return shape
        case Hull():
            capsule = quick_capsule(shape.vertices)
            return Capsule(capsule.ends, capsule.radius + shape.radius)
    return Capsule.sphere(shape.core[0], 0.0)


def _length(capsule: Capsule) -> float:
    return float(np.linalg.norm(capsule.ends[1] - capsule.ends[0]))


def _columns(body: Body, cover: Capsule) -> Array:
    """Return start, unit direction and middle (3, 3) of a body in its frame, in columns.

    Start and direction are those of its cover; the direction of a half-space is its normal.
    """
    if isinstance(body.shape, HalfSpace):
        point = body.shape.core[0]
        return np.stack((point, body.shape.normal, point), axis=1)
    start, end = cover.ends
    direction = (end - start) / (_length(cover) or 1.0)
    middle, _ = body.bounding_ball
    return np.stack((start, direction, middle), axis=1)
