"""Obstacles as triangles: what a picture or a report draws of a shape."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from wbc.robot.collision import HalfSpace, Shape
from wbc.robot.formats.triangles import Triangles
from wbc.validate import Array

AROUND = 24  # points around a rounded edge
ROUND = 1e-6  # m: less is not rounded


def solid_surface(shape: Shape, centre: Array, reach: float, ground: float) -> Triangles:
    """Return the triangles of a shape in its own frame.

    Parameters
    ----------
    centre:
        (3,) in that frame: a half-space, which has no end, is drawn as a square about the point of
        its surface nearest to it.
    reach:
        Half the side of that square [m].
    ground:
        Lowest height of an upright wall [m], in that frame.
    """
    if isinstance(shape, HalfSpace):
        return _pane(shape, centre, reach, ground)
    points = shape.core
    if shape.radius > ROUND:
        points = (points[:, None] + shape.radius * _sphere()).reshape(-1, 3)
    hull = ConvexHull(points)
    used, faces = np.unique(hull.simplices, return_inverse=True)
    return Triangles(points[used], faces.reshape(hull.simplices.shape))


def _pane(wall: HalfSpace, centre: Array, reach: float, ground: float) -> Triangles:
    normal = wall.normal
    middle = centre - (normal @ centre - wall.offset) * normal
    upright = abs(float(normal[2])) < 0.9
    along = np.cross(normal, (0.0, 0.0, 1.0) if upright else (1.0, 0.0, 0.0))
    along /= np.linalg.norm(along)
    up = np.cross(along, normal)
    up *= 1.0 if up[2] >= 0.0 else -1.0
    low = -reach
    if upright:
        low = max(low, (ground - float(middle[2])) / float(up[2]))
    corners = [middle + a * along + b * up for a, b in _square(reach, low)]
    return Triangles(np.array(corners), np.array(((0, 1, 2), (0, 2, 3))))


def _square(reach: float, low: float) -> list[tuple[float, float]]:
    return [(-reach, low), (reach, low), (reach, reach), (-reach, reach)]


def _sphere() -> Array:
    """Return points of the unit sphere, its poles and the corners of rings of equal height."""
    heights = np.linspace(-1.0, 1.0, AROUND // 2 + 1) * 0.5 * np.pi
    angles = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    height, angle = np.meshgrid(heights, angles, indexing="ij")
    flat = np.cos(height)
    points = np.stack((flat * np.cos(angle), flat * np.sin(angle), np.sin(height)), axis=-1)
    return points.reshape(-1, 3)
