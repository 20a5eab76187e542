"""The CoM kept over the support polygon."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from wbc.constraints.clearance import SKIN, Approach, Clearance, point_bend
from wbc.constraints.limits import Limits
from wbc.constraints.rows import Gaps, Index, SymbolicRows, picked
from wbc.constraints.support_polygon import support_polygon
from wbc.errors import InvalidInputError
from wbc.polygon import convex_hull
from wbc.robot import Robot, Snapshot
from wbc.validate import Array, finite_array, finite_number, read_only

if TYPE_CHECKING:
    from wbc.robot.symbolic import SymbolicPosture

COM_BRAKING = 1.0  # m/s^2: what the ground lets a humanoid's CoM do


class ComSupport(Clearance):
    """Keep the CoM's projection inside a polygon on the ground, ``margin`` from its edges.

    Outside, or nearer to an edge than the margin, the CoM is brought back as a body is out of a
    margin: at a bounded rate, by a cost that outweighs the tasks.

    Parameters
    ----------
    polygon:
        Corners (k, 2) [m], world x and y, in any order; see :meth:`over`.
    margin:
        Distance kept from the edges [m].
    approach:
        By default with a deceleration of 1 m/s^2.

    Raises
    ------
    InvalidInputError
        A polygon without area, or one that the margin leaves nothing of.
    """

    def __init__(
        self,
        robot: Robot,
        polygon: ArrayLike,
        *,
        margin: float = 0.01,
        approach: Approach | None = None,
        limits: Limits | None = None,
    ) -> None:
        super().__init__(robot, "com support", approach or Approach(braking=COM_BRAKING), limits)
        self.margin = finite_number("com support, margin", margin, least=0.0)
        self.set_polygon(polygon)

    @classmethod
    def over(
        cls, snapshot: Snapshot, feet: Iterable[str] = ("left", "right"), *, margin: float = 0.01
    ) -> ComSupport:
        """Return the constraint for the soles of ``feet`` where they are in ``snapshot``."""
        return cls(snapshot.robot, support_polygon(snapshot, feet), margin=margin)

    def set_polygon(self, polygon: ArrayLike) -> None:
        """Change the polygon, for instance when a foot is lifted; see the class."""
        given = np.asarray(polygon, dtype=float)
        points = finite_array("com support, polygon", polygon, (len(given), 2))
        corners = convex_hull(points)
        edges = np.roll(corners, -1, axis=0) - corners
        lengths = np.linalg.norm(edges, axis=1)
        if len(corners) < 3:
            raise InvalidInputError("com support, polygon: has no area; give three corners or more")
        inward = np.stack((-edges[:, 1], edges[:, 0]), axis=1) / lengths[:, None]
        offsets = np.einsum("ki,ki->k", inward, corners) + self.margin
        middle = corners.mean(axis=0)
        if (inward @ middle <= offsets).any():
            raise InvalidInputError(
                f"com support, margin: {self.margin:g} m leaves nothing of the polygon"
            )
        self.corners = read_only(corners)
        self._inward, self._offsets = inward, offsets
        self._names = tuple(f"com vs support edge {k}" for k in range(len(corners)))
        self._keys = np.arange(len(corners))

    def gaps(self, snapshot: Snapshot, keys: Index | None = None) -> Gaps:
        """Return the distances of the CoM from the edges."""
        room = self._inward @ snapshot.com[:2] - self._offsets - SKIN
        return Gaps(self._keys, room, self._inward @ snapshot.com_jacobian[:2], None)

    def symbolic_rows(self, posture: SymbolicPosture) -> SymbolicRows:
        """Return one row for each edge."""
        value = posture.com[:2].T @ self._inward.T
        return SymbolicRows(value.T, self._offsets + SKIN, np.full(len(self.corners), np.inf))

    def labels(self, gaps: Gaps) -> tuple[str, ...]:
        """Return labels such as ``"com vs support edge 2"``: from corner 2 to corner 3."""
        return picked(self._names, gaps.keys)

    def bend(self, gaps: Gaps, step: Array) -> Array:
        """Return how far the CoM may end beside its linear prediction."""
        return point_bend(gaps, step)
