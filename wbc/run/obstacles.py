"""What stands around a robot in a run: the obstacles' shapes, and where they are tick by tick."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wbc.constraints import Constraint
from wbc.constraints.obstacles import Obstacles
from wbc.robot.collision import Capsule, HalfSpace, Hull, Obstacle, Shape
from wbc.validate import Array

PLACE, CORE, RADIUS, NORMAL = "place", "core", "radius", "normal"


@dataclass(frozen=True, eq=False)
class ObstacleTrack:
    """An obstacle over a run."""

    shape: Shape  # in the obstacle's own frame
    place: Array  # (n, 3, 4) rotation and origin [m] of that frame; NaN while it is not watched

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return what :meth:`from_arrays` makes a track of."""
        shape: dict[str, NDArray[np.generic]] = {CORE: self.shape.core}
        if isinstance(self.shape, HalfSpace):
            shape[NORMAL] = self.shape.normal
        else:
            shape[RADIUS] = np.array(self.shape.radius)
        return {PLACE: self.place, **shape}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.generic]]) -> ObstacleTrack:
        """Return the track that :meth:`arrays` took apart.

        Raises
        ------
        KeyError
            An array is missing.
        """
        place, core = np.asarray(arrays[PLACE], float), np.asarray(arrays[CORE], float)
        if NORMAL in arrays:
            normal = np.asarray(arrays[NORMAL], float)
            return cls(HalfSpace.of(normal, float(normal @ core[0])), place)
        radius = float(arrays[RADIUS])
        shape = Capsule(core, radius) if len(core) == 2 else Hull(core, radius)
        return cls(shape, place)


def obstacles_of(constraints: Iterable[Constraint]) -> Iterator[tuple[str, Obstacle]]:
    """Yield every obstacle with its name, such as ``room/wall``."""
    for constraint in constraints:
        if isinstance(constraint, Obstacles):
            for one in constraint.obstacles:
                yield f"{constraint.name}/{one.name}", one


def place_of(obstacle: Obstacle) -> Array:
    """Return rotation and origin (3, 4) of an obstacle's frame."""
    return np.column_stack((obstacle.rotation, obstacle.origin))
