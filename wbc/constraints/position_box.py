"""The origin of a frame kept in a box: a workspace, or the height of the base."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from wbc.constraints.limits import Limits
from wbc.constraints.margin import SKIN, BrakingParameters, Margin, point_curvature_bound
from wbc.constraints.rows import Distances, SymbolicRows, take
from wbc.errors import InvalidInputError
from wbc.robot import Robot, Snapshot
from wbc.tasks.point import AXES
from wbc.validate import Array, Index, finite_array, read_only, real_array

if TYPE_CHECKING:
    from wbc.robot.symbolic import SymbolicPosture


class PositionBox(Margin):
    """Keep the origin of a frame in a box along the world's axes.

    Parameters
    ----------
    frame:
        Such as ``"base"``.
    lower, upper:
        (3,) [m]; infinite where there is no bound.

    Raises
    ------
    UnknownNameError
        No such frame.
    InvalidInputError
        Bounds that cross, or none at all.
    """

    frame: str
    lower: Array
    upper: Array

    _fixed = dict.fromkeys(("frame", "lower", "upper"), "make another PositionBox")

    def __init__(
        self,
        robot: Robot,
        frame: str,
        lower: ArrayLike,
        upper: ArrayLike,
        *,
        braking: BrakingParameters | None = None,
        limits: Limits | None = None,
    ) -> None:
        super().__init__(robot, f"box of {frame}", braking, limits)
        robot.frame_id(frame)
        self.frame = frame
        self.lower, self.upper = (_ends(f"box of {frame!r}", ends) for ends in (lower, upper))
        if (self.lower + 2.0 * SKIN >= self.upper).any():
            raise InvalidInputError(f"box of {frame!r}: the lower bounds must be below the upper")
        signs = np.concatenate((np.eye(3), -np.eye(3)))
        offsets = np.concatenate((self.lower, -self.upper))
        used = np.isfinite(offsets)
        if not used.any():
            raise InvalidInputError(f"box of {frame!r}: no bound is finite")
        self._signs, self._offsets = signs[used], offsets[used]
        names = [f"{frame} {axis} {end}" for end in ("lower", "upper") for axis in AXES]
        self._names = tuple(name for name, one in zip(names, used, strict=True) if one)
        self._keys = np.arange(len(self._names))

    @classmethod
    def height(
        cls, robot: Robot, lower: float, upper: float = np.inf, *, frame: str = "base"
    ) -> PositionBox:
        """Return the constraint that keeps a frame between two heights [m]."""
        return cls(robot, frame, (-np.inf, -np.inf, lower), (np.inf, np.inf, upper))

    def distances(self, snapshot: Snapshot, keys: Index | None = None) -> Distances:
        """Return the distances of the frame's origin from the faces."""
        clearance = self._signs @ snapshot.position(self.frame) - self._offsets - SKIN
        jacobian = self._signs @ snapshot.jacobian(self.frame)[:3]
        return Distances(self._keys, clearance, jacobian, None)

    def symbolic_rows(self, posture: SymbolicPosture) -> SymbolicRows:
        """Return one row for each axis that has a bound."""
        used = np.flatnonzero(np.isfinite(self.lower) | np.isfinite(self.upper))
        value = posture.position(self.frame)[used]
        return SymbolicRows(value, self.lower[used] + SKIN, self.upper[used] - SKIN)

    def labels(self, distances: Distances) -> tuple[str, ...]:
        """Return labels such as ``"base z lower"``."""
        return take(self._names, distances.keys)

    def curvature_bound(self, distances: Distances, step: Array) -> Array:
        """Bound how far the origin ends beside its linear prediction."""
        return point_curvature_bound(distances, step)


def _ends(what: str, values: ArrayLike) -> Array:
    given = real_array(what, values)
    finite_array(what, np.where(np.isinf(given), 0.0, given), (3,))
    return read_only(given)
