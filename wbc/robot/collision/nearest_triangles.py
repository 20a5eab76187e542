"""Where two surfaces are nearest: triangles elsewhere need no tree over them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.spatial.distance import cdist

from wbc.robot.formats.triangles import Triangles
from wbc.validate import Array

CELLS = 24  # along the longest side of a surface, for its clusters
TRIED = 4  # pairs of clusters, of which the corners bound the distance from above
SPARE = 1e-9  # m, for rounding
PASSES = 2  # the second one with smaller clusters, of what the first one left


class Clusters:
    """Triangles in groups of neighbours, with a ball round each.

    Attributes
    ----------
    centres, radii:
        Of the balls, (n, 3) in the surface's frame and (n,) [m].
    """

    def __init__(self, surface: Triangles) -> None:
        self.surface = surface
        corners = surface.vertices[surface.faces]  # (m, 3, 3)
        low, high = corners.min(axis=1), corners.max(axis=1)
        middles = 0.5 * (low + high)
        first = middles.min(axis=0)
        cell = max(float(np.ptp(middles, axis=0).max()), 1e-9) / CELLS
        x, y, z = ((middles - first) / cell).astype(np.int64).T
        number = (x * (CELLS + 1) + y) * (CELLS + 1) + z
        self._order = np.argsort(number, kind="stable")
        self._starts = np.flatnonzero(np.diff(number[self._order], prepend=-1))
        self._sizes = np.diff(self._starts, append=len(number))
        low = np.minimum.reduceat(low[self._order], self._starts)
        high = np.maximum.reduceat(high[self._order], self._starts)
        self.centres = 0.5 * (low + high)
        self.radii = 0.5 * np.linalg.norm(high - low, axis=1)

    def triangles(self, chosen: Array) -> Triangles:
        """Return those of some clusters, (n,) of bool, with the vertices that they have."""
        faces = self.surface.faces[np.sort(self._order[np.repeat(chosen, self._sizes)])]
        used = np.zeros(len(self.surface.vertices), dtype=bool)
        used[faces] = True
        return Triangles(self.surface.vertices[used], (np.cumsum(used) - 1)[faces])

    def corners(self, cluster: int) -> Array:
        """Return the corners (k, 3) of a cluster's triangles."""
        faces = self.surface.faces[self._order[self._starts[cluster] :][: self._sizes[cluster]]]
        return self.surface.vertices[np.unique(faces)]


def nearest_triangles(
    first: Clusters, second: Clusters, place: pin.SE3, other: pin.SE3
) -> tuple[Triangles, Triangles, float]:
    """Return the triangles of two surfaces that may be nearest to each other.

    With them comes a distance [m] that some of their corners have: the surfaces' is no larger.

    Parameters
    ----------
    place, other:
        Of the surfaces' frames in a common one.
    """
    most = np.inf
    for _ in range(PASSES):
        least = cdist(_placed(first.centres, place), _placed(second.centres, other))
        least -= first.radii[:, None] + second.radii
        each = least.min(axis=1)
        for i in np.argsort(each)[:TRIED].tolist():
            j = int(least[i].argmin())
            corners = _placed(first.corners(i), place), _placed(second.corners(j), other)
            most = min(most, float(cdist(*corners).min()))
        near = least <= most + SPARE
        first = Clusters(first.triangles(near.any(axis=1)))
        second = Clusters(second.triangles(near.any(axis=0)))
    return first.surface, second.surface, most


def _placed(points: Array, place: pin.SE3) -> Array:
    return points @ place.rotation.T + place.translation
