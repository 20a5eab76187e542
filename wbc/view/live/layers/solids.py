"""Collision shapes as triangles."""

from __future__ import annotations

import numpy as np

from wbc.robot.collision import Capsule, Shape
from wbc.robot.geometry import Surface, rounded_cylinder
from wbc.rotations import rotation_from
from wbc.validate import Array
from wbc.view.live.layers.layer import along
from wbc.view.solids import solid_surface

PLANE = 2.0  # m: side of what is drawn of a half-space
Z = np.array([0.0, 0.0, 1.0])


def surface_of(shape: Shape) -> Surface:
    """Return the surface of a collision shape; of a half-space a square about its own origin."""
    if isinstance(shape, Capsule):
        return _capsule(shape)
    return solid_surface(shape, np.zeros(3), 0.5 * PLANE, -0.5 * PLANE)


def _capsule(shape: Capsule) -> Surface:
    """Return a capsule's surface, smooth around its own axis."""
    start, end = shape.ends
    length = float(np.linalg.norm(end - start))
    around_z = rounded_cylinder(shape.radius, 0.5 * length)
    R = _turn_z_to((end - start) / length if length > 0.0 else Z)
    return Surface(around_z.vertices @ R.T + 0.5 * (start + end), around_z.faces)


def _turn_z_to(direction: Array) -> Array:
    """Return a rotation that turns z into a unit vector."""
    w, x, y, z = along(direction)
    return rotation_from(np.array([x, y, z, w]))
