"""Margins between bodies, and the choice of pairs that get an inequality row in a tick."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np

from wbc.constraints.limits import Limits
from wbc.constraints.margin import BrakingParameters, Margin
from wbc.constraints.rows import Bounds, Distances, take
from wbc.kinds import whole_number
from wbc.robot import Robot, Snapshot
from wbc.robot.collision import CollisionModel, PairDistances
from wbc.robot.collision.native_pairs import Closing
from wbc.robot.limits import BASE_NV
from wbc.robot.model import check_sizes
from wbc.robot.series import StateSeries
from wbc.validate import Array, Index


class BodyMargin(Margin):
    """Keep pairs of bodies apart, with rows for the most critical pairs only.

    Parameters
    ----------
    pairs:
        Number of pairs with a row in each tick. At the velocity level those of least clearance; all
        others are checked at the configuration that the command leads to. At the torque level those
        with the least clearance left after braking, and beyond ``pairs`` every pair that could not
        stop in time.
    braking, limits:
        See :class:`~wbc.constraints.margin.Margin`.
    """

    count: int  # number of pairs with a row
    model: CollisionModel

    def __init__(
        self,
        robot: Robot,
        name: str,
        pairs: int,
        braking: BrakingParameters | None,
        limits: Limits | None,
    ) -> None:
        super().__init__(robot, name, braking, limits)
        self.count = pairs

    def _set_attribute(self, name: str, value: Any) -> None:
        if name == "count":  # the core allocates memory for so many
            value = whole_number(f"{self.name}, pairs", value, least=1)
        super()._set_attribute(name, value)

    @abstractmethod
    def min_distances(self) -> Array:
        """Return the least distance (N,) of each pair [m], skin included."""

    @abstractmethod
    def to_distances(
        self, snapshot: Snapshot, found: PairDistances, beyond: float | None = None
    ) -> Distances:
        """Return measured pairs as distances; all other pairs have ``beyond`` [m] at least."""

    def place(self) -> None:
        """Move the bodies that are not the robot's to their present poses."""

    def distances(self, snapshot: Snapshot, keys: Index | None = None) -> Distances:
        """Return the pairs of least clearance, or those given by their numbers."""
        check_sizes(self.name, self.robot, snapshot)
        self.place()
        model = self.model
        if keys is not None:
            return self.to_distances(snapshot, model.measure(snapshot, keys))
        return self.to_distances(
            snapshot, model.nearest(snapshot, self.count, self.min_distances())
        )

    def near(
        self, q: Array, states: StateSeries, limit: float
    ) -> tuple[Index, Index, Array, Array]:
        """Return all pairs with less clearance than ``limit`` [m] in n states.

        Which state, increasing, and which pair (k,), its clearance (k,) [m] and that one's
        derivative by v (k, nv).

        Parameters
        ----------
        q:
            Configurations (n, nq).
        states:
            Of these.
        """
        self.place()
        min_distances, model = self.min_distances(), self.model
        if not len(model.pairs):
            none = np.zeros(0, dtype=np.int64)
            return none, none, np.zeros(0), np.zeros((0, self.robot.nv))
        given, native = (states.array, states.tree), model.native
        pairs, found = native.within(*given, limit, min_distances)
        unknown = np.unique(pairs[found[:, 0] == -np.inf, 0])
        known = ~np.isin(pairs[:, 0], unknown)
        pairs, found = pairs[known], found[known]
        clearance = found[:, 0] - min_distances.take(pairs[:, 1])
        parts = [(*pairs.T, clearance, native.rows_within(*given, pairs, found))]
        every = np.arange(len(model.pairs))
        for k in unknown.tolist():
            one = self.distances(self.robot.snapshot(q[k]), every)
            own = one.clearance < limit
            where: Index = np.full(np.count_nonzero(own), k)
            parts.append((where, one.keys[own], one.clearance[own], one.jacobian[own]))
        frames, pairs, *rest = (np.concatenate(part) for part in zip(*parts, strict=True))
        order = np.argsort(frames, kind="stable")
        return frames[order], pairs[order], rest[0][order], rest[1][order]

    def braked_rows(self, snapshot: Snapshot, dt: float) -> Bounds:
        """Return the rows of the pairs that must brake first: see ``pairs`` of the class.

        With finite torques nothing stops at once, and a far pair may close faster than a near one.
        """
        law, able, slowest = self.braking, self._joint_acceleration, 0.0
        if not len(self.model.pairs):
            return self.rows(snapshot, dt)
        if able is not None:
            slowest = float((np.abs(snapshot.v[BASE_NV:]) / able).max(initial=0.0))
        closing = Closing(dt, law.deceleration, law.gain, slowest)
        self.place()
        found, left = self.model.soonest(snapshot, self.count, self.min_distances(), closing)
        return self._rows(self.to_distances(snapshot, found, float(left.max())), dt)

    def curvature_bound(self, distances: Distances, step: Array) -> Array:
        """See :meth:`wbc.robot.collision.CollisionModel.curvature_bound`."""
        return self.model.curvature_bound(distances.keys, step)

    def has_more(self, distances: Distances) -> bool:
        """Whether there are pairs without rows."""
        return distances.keys.size < len(self.model.pairs)

    def labels(self, distances: Distances) -> tuple[str, ...]:
        """Return labels such as ``"left_hand vs pelvis"``."""
        every = self.model.labels
        return every if distances.keys.size == len(every) else take(every, distances.keys)
