"""Obstacles of a run: their shapes, and their placements tick by tick."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wbc.constraints import Constraint
from wbc.constraints.obstacles import Obstacles
from wbc.errors import InvalidInputError
from wbc.robot.collision import Capsule, HalfSpace, Hull, Obstacle, Shape
from wbc.validate import Array, finite_array, finite_number

PLACE, CORE, RADIUS, NORMAL = "place", "core", "radius", "normal"


@dataclass(frozen=True, eq=False)
class ObstacleTrack:
    """An obstacle over a run."""

    shape: Shape  # in the obstacle's own frame
    place: Array  # (n, 3, 4) rotation and origin [m] of that frame; NaN while not in use

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return the arrays that :meth:`from_arrays` reads."""
        shape: dict[str, NDArray[np.generic]] = {CORE: self.shape.core}
        if isinstance(self.shape, HalfSpace):
            shape[NORMAL] = self.shape.normal
        else:
            shape[RADIUS] = np.array(self.shape.radius)
        return {PLACE: self.place, **shape}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.generic]]) -> ObstacleTrack:
        """Return the track of :meth:`arrays`.

        Raises InvalidInputError: an array is not of its shape, or its numbers are not finite;
        KeyError: one is missing.
        """
        place = np.asarray(arrays[PLACE], dtype=float)
        if place.ndim != 3 or place.shape[1:] != (3, 4):
            raise InvalidInputError(f"obstacle, place: expected (n, 3, 4), got {place.shape}")
        core = finite_array("obstacle, core", arrays[CORE], (len(np.atleast_1d(arrays[CORE])), 3))
        if not len(core):
            raise InvalidInputError("obstacle, core: has no points")
        if NORMAL in arrays:
            normal = finite_array("obstacle, normal", arrays[NORMAL], (3,))
            return cls(HalfSpace.of(normal, float(normal @ core[0])), place)
        radius = finite_number("obstacle, radius", arrays[RADIUS], least=0.0)
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
