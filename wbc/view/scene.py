"""What is in a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wbc.rmp import Ellipsoid
from wbc.robot.geometry import Mesh
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class Scene:
    """What is drawn, in world coordinates.

    Attributes
    ----------
    meshes:
        The robot; empty if its description holds no shapes.
    ellipsoid, centre:
        Its equimomental ellipsoid in world axes, and the CoM (3,) [m].
    tint:
        Colour of the ellipsoid, (3,) in [0, 1].
    ground:
        Altitude of the ground [m].
    """

    meshes: Sequence[Mesh]
    ellipsoid: Ellipsoid
    centre: Array
    tint: Array
    ground: float

    @cached_property
    def corners(self) -> Array:
        """Triangles (m, 3, 3): triangle, corner, coordinate [m]."""
        parts = [mesh.vertices[mesh.faces] for mesh in self.meshes]
        return np.concatenate([np.empty((0, 3, 3)), *parts])

    @cached_property
    def colours(self) -> Array:
        """Colour of each triangle (m, 3)."""
        parts = [np.tile(mesh.colour, (len(mesh.faces), 1)) for mesh in self.meshes]
        return np.concatenate([np.empty((0, 3)), *parts])

    @cached_property
    def size(self) -> float:
        """What lengths in the picture go by [m]: the largest extent along x, y or z."""
        reach = float(self.ellipsoid.semi_axes.max())
        points = self.corners.reshape(-1, 3)
        low = points.min(axis=0, initial=np.inf)
        high = points.max(axis=0, initial=-np.inf)
        low, high = np.minimum(low, self.centre - reach), np.maximum(high, self.centre + reach)
        return float((high - low).max())
