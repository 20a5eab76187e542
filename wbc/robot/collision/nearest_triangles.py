"""The triangles where two surfaces may be nearest, so that a BVH is built only over these."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.spatial.distance import cdist

from wbc.robot.formats.triangles import Triangles, without_unused_vertices
from wbc.validate import Array

CELLS = 16  # along the longest side of a surface, for its clusters
BOUND_PAIRS = 4  # pairs of clusters whose corners give an upper bound on the distance
ROUNDING = 1e-9  # m, for rounding
PASSES = 3  # each with smaller clusters of the remaining triangles,
FEW_TRIANGLES = 3000  # until no more than so many remain


class Clusters:
    """Triangles in groups of neighbours, with bounding balls; those longer than a cell are cut.

    Attributes
    ----------
    centres, radii:
        Of the balls, (n, 3) in the surface's frame and (n,) [m].
    """

    def __init__(self, surface: Triangles) -> None:
        self.surface = surface
        corners = np.ascontiguousarray(surface.vertices.T)[:, surface.faces.T]  # (x y z, 3, m)
        owners, first = np.arange(len(surface.faces)), surface.vertices.min(axis=0)
        cell = max(float((surface.vertices.max(axis=0) - first).max()) / CELLS, 1e-9)
        pieces, their = [], []
        while owners.size:
            low, high = _boxes(corners)
            short = (high - low <= cell).all(axis=0)
            pieces.append(corners[:, :, short])
            their.append(owners[short])
            corners, owners = _bisected(corners[:, :, ~short]), np.tile(owners[~short], 2)
        corners, owners = np.concatenate(pieces, axis=2), np.concatenate(their)
        lows, highs = _boxes(corners)
        x, y, z = ((0.5 * (lows + highs) - first[:, None]) / cell).astype(np.int16)
        number = (x * (CELLS + 1) + y) * (CELLS + 1) + z  # of two bytes: sorted in one go
        order = np.argsort(number, kind="stable")
        self._corners, self._owners, self._order = corners, owners, order
        self._starts = np.flatnonzero(np.diff(number[order], prepend=-1))
        self._sizes = np.diff(self._starts, append=len(number))
        lows = np.minimum.reduceat(lows[:, order], self._starts, axis=1)
        highs = np.maximum.reduceat(highs[:, order], self._starts, axis=1)
        self.centres = 0.5 * (lows + highs).T
        self.radii = 0.5 * np.linalg.norm(highs - lows, axis=0)

    def triangles(self, chosen: Array) -> Triangles:
        """Return the triangles of some clusters, (n,) of bool, with their vertices."""
        kept = np.zeros(len(self.surface.faces), dtype=bool)
        kept[self._owners[self._order[np.repeat(chosen, self._sizes)]]] = True
        return without_unused_vertices(self.surface.vertices, self.surface.faces[kept])

    def corners(self, cluster: int) -> Array:
        """Return the corners (k, 3) of a cluster's triangles."""
        start = self._starts[cluster]
        own = self._order[start : start + self._sizes[cluster]]
        return self._corners[:, :, own].reshape(3, -1).T


def _boxes(corners: Array) -> tuple[Array, Array]:
    """Return the least and the largest coordinates (3, m) of triangles."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]  # a reduction takes five times as long
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def _bisected(corners: Array) -> Array:
    """Return two triangles (3, 3, 2 m) for each, cut across its longest side."""
    sides = corners - corners[:, [1, 2, 0]]  # of side k: from the corner after it
    longest = np.einsum("ikm,ikm->km", sides, sides).argmax(axis=0)
    every = np.arange(len(longest))
    a, b, c = (corners[:, (longest + k) % 3, every] for k in range(3))
    middle = 0.5 * (a + b)
    return np.concatenate((np.stack((a, middle, c), 1), np.stack((middle, b, c), 1)), axis=2)


def nearest_triangles(
    first: Clusters, second: Clusters, place: pin.SE3, other: pin.SE3
) -> tuple[Triangles, Triangles, float]:
    """Return the triangles of two surfaces that may be nearest to each other.

    And an upper bound on the surfaces' distance [m].

    Parameters
    ----------
    place, other:
        Of the surfaces' frames in a common one.
    """
    most = np.inf
    for k in range(PASSES):
        apart = cdist(_transformed(first.centres, place), _transformed(second.centres, other))
        radii = first.radii[:, None] + second.radii
        nearest = apart + radii  # of any point in one ball to any in the other, at most
        each = nearest.min(axis=1)
        most = min(most, float(each.min()))
        for i in np.argsort(each)[:BOUND_PAIRS].tolist():
            j = int(nearest[i].argmin())
            corners = _transformed(first.corners(i), place), _transformed(second.corners(j), other)
            most = min(most, float(cdist(*corners).min()))
        near = apart - radii <= most + ROUNDING
        left = first.triangles(near.any(axis=1)), second.triangles(near.any(axis=0))
        if k + 1 == PASSES or max(len(one.faces) for one in left) <= FEW_TRIANGLES:
            break
        first, second = map(Clusters, left)
    return *left, most


def _transformed(points: Array, place: pin.SE3) -> Array:
    return points @ place.rotation.T + place.translation
