"""Nearest points of many pairs of segments at once.

A segment is its start, its unit direction and its length; a point has length zero. The way through
the cases is that of Ericson, Real-Time Collision Detection (2005), sec. 5.1.9, without branches.

Components come first, (3, k): NumPy takes a third of the time along the long side.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.validate import Array

PARALLEL = 1e-10  # squared sine of an angle below which two segments count as parallel
TOUCHING = 1e-9  # m: nearer axes have no direction between them


class Nearest(NamedTuple):
    """Of each of k pairs of segments A, B.

    Attributes
    ----------
    distance:
        (k,) [m], not negative.
    normal:
        (3, k) unit vectors from B to A.
    point:
        (3, k) on A.
    """

    distance: Array
    normal: Array
    point: Array


def nearest_points(A: Array, B: Array, length_a: Array, length_b: Array) -> Nearest:
    """Return what is nearest between segments A and B.

    Where axes touch, the normal is the common perpendicular of the two axes on the side of A's
    middle; for parallel axes, the direction between the middles or any perpendicular.

    Parameters
    ----------
    A, B:
        (2 or more, 3, k): start, unit direction (anything for a point).
    length_a, length_b:
        (k,) [m], 0 for points.
    """
    a, b = A[1], B[1]
    between = A[0] - B[0]
    s, t = _shares(a, b, between, length_a, length_b)
    along_a = s * a
    apart = between + along_a
    apart -= t * b
    distance = np.sqrt(_inner(apart, apart))
    if distance.size and np.minimum.reduce(distance) < TOUCHING:
        normal = apart / np.maximum(distance, TOUCHING)
        for k in np.flatnonzero(distance < TOUCHING):
            normal[:, k] = _fallback(length_a[k] * a[:, k], length_b[k] * b[:, k], between[:, k])
    else:
        normal = np.divide(apart, distance, out=apart)
    along_a += A[0]
    return Nearest(distance, normal, along_a)


def _shares(
    a: Array, b: Array, between: Array, length_a: Array, length_b: Array
) -> tuple[Array, Array]:
    """Return how far along A and along B (k,), (k,) the nearest points are [m]."""
    ab, ar, br = _inner(a, b), _inner(a, between), _inner(b, between)
    sine = 1.0 - ab * ab
    # Parallel segments: any s will do.
    s = _within((ab * br - ar) / np.maximum(sine, PARALLEL, out=sine), length_a)
    t = _within(ab * s + br, length_b)
    return _within(ab * t - ar, length_a), t


def _inner(x: Array, y: Array) -> Array:
    """Return the inner products (k,) of vectors (3, k)."""
    return np.asarray(np.add.reduce(x * y))


def _within(x: Array, length: Array) -> Array:
    np.maximum(x, 0.0, out=x)
    return np.minimum(x, length, out=x)


def _fallback(a: Array, b: Array, between: Array) -> Array:
    """Return a unit vector to push apart two segments whose axes touch."""
    middles = between + 0.5 * (a - b)
    across = np.cross(a, b)
    if float(across @ across) <= PARALLEL * float(a @ a) * float(b @ b):
        axis = a if float(a @ a) >= float(b @ b) else b
        across = _perpendicular(middles, axis)
    across = across / np.linalg.norm(across)
    return across if float(across @ middles) >= 0.0 else -across


def _perpendicular(wanted: Array, axis: Array) -> Array:
    """Return what is left of ``wanted`` across ``axis``; any perpendicular if nothing is."""
    squared = float(axis @ axis)
    for direction in (wanted, np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])):
        left = direction - (float(direction @ axis) / squared * axis if squared > 0.0 else 0.0)
        if np.linalg.norm(left) > TOUCHING:
            return np.asarray(left)
    return np.array([0.0, 1.0, 0.0])  # not reached: one of z and x is off the axis
