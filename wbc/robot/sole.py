"""The flat underside of a rigid body: its lowest points and their convex hull."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin

from wbc.validate import Array

FLAT = 3e-3  # m: points no higher than this above the lowest belong to the sole
STRAIGHT = 2e-3  # m: a corner that sticks out less than this is not worth a vertex
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
_RIM = np.linspace(0.0, 2 * np.pi, 16, endpoint=False)
_DISC = np.stack([np.cos(_RIM), np.sin(_RIM), np.zeros_like(_RIM)], axis=1)  # (16, 3)


def extreme_points(shape: object, up: Array) -> Array:
    """Return points (k, 3) of a collision shape, in its frame, among them its lowest ones.

    Parameters
    ----------
    shape:
        A ``coal`` geometry. Shapes that end nowhere or are unknown give no points.
    up:
        Unit vector (3,) that points up, in the shape's frame.
    """
    match shape:
        case coal.Box():
            return _CORNERS * np.asarray(shape.halfSide, dtype=np.float64)
        case coal.Sphere():
            return -float(shape.radius) * up[None]
        case coal.Ellipsoid():
            radii = np.asarray(shape.radii, dtype=np.float64)
            return -(radii**2 * up / np.linalg.norm(radii * up))[None]
        case coal.Capsule():
            return _ends(shape.halfLength) - float(shape.radius) * up
        case coal.Cylinder():
            rim = float(shape.radius) * _DISC @ _turn_to(up)
            return np.concatenate([rim + end for end in _ends(shape.halfLength)])
        case coal.Cone():
            apex, base = _ends(shape.halfLength)
            rim = float(shape.radius) * _DISC @ _turn_to(up)
            return np.concatenate([rim + base, apex[None]])
        case coal.ConvexBase():
            return np.array(shape.points())
        case coal.BVHModelBase():
            return np.array(shape.vertices())
    return np.empty((0, 3))


def _ends(half_length: float) -> Array:
    return np.array([[0.0, 0.0, half_length], [0.0, 0.0, -half_length]])


def _turn_to(up: Array) -> Array:
    """Return the rotation about z after which the first rim point is the lowest."""
    angle = np.arctan2(-up[1], -up[0])
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def body_points(shapes: pin.GeometryModel, joint: int, up: Array) -> Array:
    """Return the extreme points (k, 3) of all shapes on one joint's body, in the joint's frame.

    Parameters
    ----------
    up:
        Unit vector (3,) that points up, in the joint's frame.
    """
    found = [np.empty((0, 3))]
    for shape in shapes.geometryObjects:
        if shape.parentJoint == joint:
            R, p = shape.placement.rotation, shape.placement.translation
            points = extreme_points(shape.geometry, R.T @ up)
            found.append(points @ R.T + p)
    return np.concatenate(found)


def convex_hull(points: Array) -> Array:
    """Return the corners (k, 2) of the convex hull of points (n, 2), counter-clockwise.

    Andrew's monotone chain; collinear and repeated points are dropped.
    """
    rows = sorted({(float(x), float(y)) for x, y in points})
    if len(rows) < 3:
        return np.array(rows).reshape(-1, 2)  # a point or a segment is its own hull
    lower, upper = _chain(rows), _chain(rows[::-1])
    return np.array(lower[:-1] + upper[:-1])


def _chain(rows: list[tuple[float, float]]) -> list[tuple[float, float]]:
    chain: list[tuple[float, float]] = []
    for point in rows:
        while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0.0:
            chain.pop()
        chain.append(point)
    return chain


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    """Return twice the signed area of a triangle, positive when a, b, c turn left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def thinned(polygon: Array, tolerance: float = STRAIGHT) -> Array:
    """Return a convex polygon (k, 2) without its flattest corners.

    A corner goes if it sticks out less than ``tolerance`` [m] from the edge that replaces it. What
    is left lies inside the polygon given, so a contact claimed on it is one the foot can give.
    """
    corners = [(float(x), float(y)) for x, y in polygon]
    while len(corners) > 4:  # a quadrilateral is as simple as a sole needs to be
        heights = [
            _turn(a, b, c) / max(np.hypot(c[0] - a[0], c[1] - a[1]), 1e-12)
            for a, b, c in zip(
                corners[-1:] + corners[:-1], corners, corners[1:] + corners[:1], strict=True
            )
        ]
        flattest = int(np.argmin(heights))
        if heights[flattest] > tolerance:
            break
        del corners[flattest]
    return np.array(corners)


def centroid(polygon: Array) -> Array:
    """Return the centre of area (2,) of a polygon (k, 2), or of a segment or point."""
    x, y = polygon.T
    x1, y1 = np.roll(polygon, -1, axis=0).T
    cross = x * y1 - x1 * y
    area = cross.sum() / 2
    if abs(area) < 1e-9:  # m^2: a thousandth of a square millimetre
        return np.asarray(polygon.mean(axis=0))
    return np.array([(x + x1) @ cross, (y + y1) @ cross]) / (6 * area)
