"""Collision shapes as triangles."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from wbc.robot.collision import Capsule, HalfSpace, Hull, Shape
from wbc.robot.geometry import Surface, box, rounded_cylinder
from wbc.rotations import rotation_from
from wbc.validate import Array
from wbc.view.live.layers.layer import along

PLANE = 2.0  # m: side of what is drawn of a half-space


def surface_of(shape: Shape) -> Surface:
    """Return the surface of a collision shape; of a half-space a thin square.

    The rounding of a hull is left out.
    """
    if isinstance(shape, Capsule):
        start, end = shape.ends
        length = float(np.linalg.norm(end - start))
        surface = rounded_cylinder(shape.radius, 0.5 * length)
        direction = (end - start) / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
        return _moved(surface, direction, 0.5 * (start + end))
    if isinstance(shape, Hull):
        hull = ConvexHull(shape.vertices)
        return Surface(shape.vertices, hull.simplices.astype(np.int64))
    assert isinstance(shape, HalfSpace)
    slab = box(np.array([0.5 * PLANE, 0.5 * PLANE, 0.002]))
    return _moved(slab, shape.normal, shape.offset * shape.normal)


def _moved(surface: Surface, direction: Array, origin: Array) -> Surface:
    """Turn z into ``direction`` and shift by ``origin``."""
    w, x, y, z = along(direction)
    rotation = rotation_from(np.array([x, y, z, w]))
    return Surface(surface.vertices @ rotation.T + origin, surface.faces)
