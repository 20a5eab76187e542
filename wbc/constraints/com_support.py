"""The CoM kept over the support polygon: what the soles that stand span, seen from above."""

from __future__ import annotations

from collections.abc import Iterable, Sized
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from wbc.constraints.limits import Limits
from wbc.constraints.margin import SKIN, BrakingParameters, Margin, point_curvature_bound
from wbc.constraints.rows import Distances, SymbolicRows, take
from wbc.errors import InvalidInputError
from wbc.polygon import CONVEX, convex_hull
from wbc.robot import Robot, Snapshot
from wbc.robot.model import check_snapshot
from wbc.validate import Array, Index, clearance, finite_array, names_of, read_only

if TYPE_CHECKING:
    from wbc.robot.symbolic import SymbolicPosture

COM_BRAKING = 1.0  # m/s^2: what the ground lets a humanoid's CoM do


class ComSupport(Margin):
    """Keep the CoM's projection inside a polygon on the ground, ``margin`` from its edges.

    Outside, or nearer to an edge than the margin, the CoM is brought back as a body is out of a
    margin: at a bounded rate, by a cost that outweighs the tasks.

    Parameters
    ----------
    polygon:
        Corners (k, 2) [m], world x and y, in any order; see :meth:`over`.
    margin:
        Distance kept from the edges [m].
    braking:
        By default with a deceleration of 1 m/s^2.

    Raises
    ------
    InvalidInputError
        A polygon without area, or one that the margin leaves nothing of.
    """

    _fixed: ClassVar = {"margin": "make another ComSupport", "corners": "call set_polygon()"}
    margin: float
    corners: Array  # (k, 2) of the polygon [m], counter-clockwise, read-only

    def __init__(
        self,
        robot: Robot,
        polygon: ArrayLike,
        *,
        margin: float = 0.01,
        braking: BrakingParameters | None = None,
        limits: Limits | None = None,
    ) -> None:
        braking = BrakingParameters(COM_BRAKING) if braking is None else braking
        super().__init__(robot, "com support", braking, limits)
        self.margin = clearance("com support", margin)
        self.set_polygon(polygon)

    @classmethod
    def over(
        cls, snapshot: Snapshot, feet: Iterable[str] | None = None, *, margin: float = 0.01
    ) -> ComSupport:
        """Return the constraint for the soles of ``feet`` (None: all) where they are now."""
        check_snapshot("ComSupport.over", snapshot)
        feet = snapshot.robot.feet if feet is None else feet
        return cls(snapshot.robot, support_polygon(snapshot, feet), margin=margin)

    def set_polygon(self, polygon: ArrayLike) -> None:
        """Change the polygon, for instance when a foot is lifted; see the class."""
        count = len(polygon) if isinstance(polygon, Sized) else 0
        points = finite_array("com support, polygon", polygon, (count, 2))
        corners = convex_hull(points, CONVEX)  # of edges in line one row, not one for each sole
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
        self.__dict__["corners"] = read_only(corners)
        self._inward, self._offsets = inward, offsets
        self._names = tuple(f"com vs support edge {k}" for k in range(len(corners)))
        self._keys = np.arange(len(corners))

    def distances(self, snapshot: Snapshot, keys: Index | None = None) -> Distances:
        """Return the distances of the CoM from the edges."""
        clearance = self._inward @ snapshot.com[:2] - self._offsets - SKIN
        return Distances(self._keys, clearance, self._inward @ snapshot.com_jacobian[:2], None)

    def symbolic_rows(self, posture: SymbolicPosture) -> SymbolicRows:
        """Return one row for each edge."""
        value = posture.com[:2].T @ self._inward.T
        return SymbolicRows(value.T, self._offsets + SKIN, np.full(len(self.corners), np.inf))

    def labels(self, distances: Distances) -> tuple[str, ...]:
        """Return labels such as ``"com vs support edge 2"``: from corner 2 to corner 3."""
        return take(self._names, distances.keys)

    def curvature_bound(self, distances: Distances, step: Array) -> Array:
        """Bound how far the CoM ends beside its linear prediction."""
        return point_curvature_bound(distances, step)


def support_polygon(snapshot: Snapshot, feet: Iterable[str]) -> Array:
    """Return the corners (k, 2) [m] of the hull of the feet's soles, counter-clockwise, read-only.

    World x and y of the soles' corners, wherever the soles are: whether a foot touches the ground
    is the caller's knowledge.

    ``feet``: feet that stand, such as ``("left", "right")``.

    Raises UnknownNameError: the robot has no such foot; InvalidInputError: no feet at all.
    """
    check_snapshot("support polygon", snapshot)
    robot = snapshot.robot
    names = names_of("support polygon, feet", feet)
    if not names:
        raise InvalidInputError("feet: name at least one foot that stands on the ground")
    corners = []
    for name in names:
        foot = robot.foot(name)
        R, p = snapshot.rotation(foot.frame), snapshot.position(foot.frame)
        corners.append(foot.polygon @ R[:2, :2].T + p[:2])
    return read_only(convex_hull(np.concatenate(corners)))
