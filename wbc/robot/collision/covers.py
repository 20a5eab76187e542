"""Balls and capsules round bodies: they bound the distances of many pairs at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wbc.robot.collision.fitting import quick_capsule
from wbc.robot.collision.shapes import Body, Capsule, HalfSpace, Hull, Shape
from wbc.validate import Array


def covers(bodies: Sequence[Body]) -> tuple[Array, Array]:
    """Return a ball and a capsule round each body; that of a capsule is itself.

    Of a half-space, the ball is a point of its surface, and nothing else is round it.

    Returns
    -------
    local : Array
        (bodies, 3, 3) start, unit direction and middle of each, in columns, in its joint's axes.
    sizes : Array
        (bodies, 3) length and radius of the capsule, radius of the ball [m].
    """
    found = [_cover(body.shape) for body in bodies]
    local = np.stack([_columns(*both) for both in zip(bodies, found, strict=True)])
    lengths, radii = [_length(cover) for cover in found], [cover.radius for cover in found]
    return local, np.column_stack((lengths, radii, [body.bounding_ball[1] for body in bodies]))


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
