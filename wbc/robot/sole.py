"""The flat underside of a rigid body: its lowest points and their convex hull."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin

from wbc.validate import Array

FLAT = 3e-3  # m: points no higher than this above the lowest belong to the sole
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
