"""Nearest points of many pairs of segments at once.

A segment is its start and its direction; a point has direction zero. The way through the cases is
that of Ericson, Real-Time Collision Detection (2005), sec. 5.1.9, without branches.
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
        (k, 3) unit vectors from B to A.
    point:
        (k, 3) on A.
    """

    distance: Array
    normal: Array
    point: Array


def nearest_points(A: Array, B: Array, shrink_a: Array, shrink_b: Array) -> Nearest:
    """Return what is nearest between segments A and B.

    Where axes touch, the normal is the common perpendicular of the two axes on the side of A's
    middle; for parallel axes, the direction between the middles or any perpendicular.

    Parameters
    ----------
    A, B:
        (k, 3, 2 or more): start, direction in columns.
    shrink_a, shrink_b:
        (k,) one over the squared lengths, 0 for points: they do not change with the posture.
    """
    V = np.empty((len(A), 3, 3))
    V[:, :, 0] = A[:, :, 1]
    V[:, :, 1] = B[:, :, 1]
    between = np.subtract(A[:, :, 0], B[:, :, 0], out=V[:, :, 2])
    G = np.matmul(V.transpose(0, 2, 1), V)  # all inner products
    s, t = _shares(G, shrink_a, shrink_b)
    along_a = s[:, None] * V[:, :, 0]
    apart = between + along_a
    apart -= t[:, None] * V[:, :, 1]
    distance = np.sqrt(np.einsum("ki,ki->k", apart, apart))
    touching = distance.size > 0 and np.minimum.reduce(distance) < TOUCHING
    safe = np.maximum(distance, TOUCHING) if touching else distance
    normal = apart / safe[:, None]
    if touching:
        for k in np.flatnonzero(distance < TOUCHING):
            normal[k] = _fallback(A[k, :, 1], B[k, :, 1], between[k])
    along_a += A[:, :, 0]
    return Nearest(distance, normal, along_a)


def _shares(G: Array, shrink_a: Array, shrink_b: Array) -> tuple[Array, Array]:
    """Return where on A and on B (k,), (k,) the nearest points are, 0 at the start, 1 at the end.

    G (k, 3, 3) holds the inner products of A's direction, B's direction, and start of A minus
    start of B.
    """
    ab, bb = G[:, 0, 1], G[:, 1, 1]
    ar, br = G[:, 0, 2], G[:, 1, 2]
    both = G[:, 0, 0] * bb
    sine = both - ab * ab
    sine[sine <= PARALLEL * both] = np.inf  # parallel, or a point: any s will do
    s = _into_unit((ab * br - ar * bb) / sine)
    t = _into_unit((ab * s + br) * shrink_b)
    s = _into_unit((ab * t - ar) * shrink_a)
    return s, t


def _into_unit(x: Array) -> Array:
    np.maximum(x, 0.0, out=x)
    return np.minimum(x, 1.0, out=x)


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
