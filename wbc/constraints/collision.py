"""The robot's own bodies kept apart."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from wbc.constraints.limits import Limits
from wbc.constraints.margin import SKIN, USED, BrakingParameters, Margin
from wbc.constraints.rows import Bounds, Distances, Index, SeparatedPairs, take
from wbc.errors import InvalidInputError
from wbc.robot import Robot, Snapshot
from wbc.robot.collision import CollisionModel, PairDistances, robot_bodies, select_pairs
from wbc.robot.collision.closing import Closing
from wbc.robot.collision.native_pairs import NativePairs
from wbc.robot.collision.pairs import BY_DESCRIPTION
from wbc.robot.limits import BASE_NV
from wbc.validate import Array, finite_number, read_only

if TYPE_CHECKING:
    from wbc.robot.symbolic import SymbolicPosture


class WatchedPairs(NamedTuple):
    """What the native core must know to keep pairs of bodies apart."""

    pairs: NativePairs
    kept: Array  # (N,) distance that each pair keeps, skin included [m]
    shorter: Array  # (N,) length of the shorter body of each pair [m]
    rows: int  # how many pairs get one
    acceleration: Array | None  # (nv - 6,) of the joints that braking may count on, or None
    braking: BrakingParameters


class SelfCollision(Margin):
    """Keep the robot's bodies ``margin`` apart.

    Parameters
    ----------
    margin:
        Distance that is kept [m].
    pairs:
        How many pairs, those of least clearance, get a row in each tick. Whether others come too
        near is looked at where the command leads. At the torque level, of least clearance when they
        have stopped; if more than these could not stop in time, they get rows, too.
    fit:
        What meshes are replaced by: ``"capsule"`` or, closer and slower, ``"hull"``.
    include, exclude:
        Pairs of patterns of links; see :func:`wbc.robot.collision.select_pairs`.
    model:
        Bodies and pairs made elsewhere, instead of ``fit``, ``include`` and ``exclude``.
    braking, limits:
        See :class:`~wbc.constraints.margin.Margin`.

    Attributes
    ----------
    margins:
        (N,) distance that each pair of the model keeps [m]: ``margin``, or half of what there is
        when standing, where that is less.
    excluded:
        The pairs that are not watched, and why.
    finer:
        The pairs that have finer shapes than ``fit`` says, and how near these stand.

    Raises
    ------
    ModelError
        A mesh is missing, or the robot has no collision shapes.
    UnknownNameError
        A pattern that matches no link.
    """

    _fixed = dict.fromkeys(("margin", "margins", "model"), "make another SelfCollision")

    def __init__(
        self,
        robot: Robot,
        *,
        margin: float = 0.01,
        pairs: int = 25,
        fit: str = "capsule",
        include: Iterable[tuple[str, str]] = (),
        exclude: Iterable[tuple[str, str]] = (),
        model: CollisionModel | None = None,
        braking: BrakingParameters | None = None,
        limits: Limits | None = None,
    ) -> None:
        super().__init__(robot, "self-collision", braking, limits)
        self.margin = finite_number("self-collision, margin", margin, least=0.0)
        self.count = int(finite_number("self-collision, pairs", pairs, least=1.0))
        self.excluded: dict[str, str] = {}
        self.finer: dict[str, str] = {}
        margins: Sequence[float] = ()
        if model is not None and ([*include], [*exclude], fit) != ([], [], "capsule"):
            raise InvalidInputError(
                "self-collision: a model has its bodies and pairs already; leave out include,"
                " exclude and fit, or the model"
            )
        if model is None:
            bodies = robot_bodies(robot, fit)
            chosen = select_pairs(
                robot, bodies, include=include, exclude=exclude, clearance=self.margin
            )
            model = CollisionModel(robot, chosen.bodies, chosen.pairs)
            margins = chosen.margins
            self.excluded, self.finer = dict(chosen.excluded), dict(chosen.finer)
        self.margins = read_only(np.array(margins or [self.margin] * len(model.pairs)))
        self._kept = self.margins + SKIN
        if model.robot is not robot:
            raise InvalidInputError("self-collision: the model was made for another robot object")
        self.model = model

    @property
    def in_contact(self) -> dict[str, str]:
        """Pairs that nobody asked to leave out and that are not watched, with the reason."""
        return {pair: why for pair, why in self.excluded.items() if why not in BY_DESCRIPTION}

    def distances(self, snapshot: Snapshot, keys: Index | None = None) -> Distances:
        """Return the pairs of least clearance, or those given by their numbers."""
        model = self.model
        found = (
            model.nearest(snapshot, self.count, self._kept)
            if keys is None
            else model.measure(snapshot, keys)
        )
        return self._distances(snapshot, found)

    def _distances(
        self, snapshot: Snapshot, found: PairDistances, beyond: float | None = None
    ) -> Distances:
        clearance, rows = found.distance - self._kept.take(found.pairs), self.model.rows
        return Distances(found.pairs, clearance, rows(snapshot, found), None, found, beyond)

    def braked_rows(self, snapshot: Snapshot, dt: float) -> Bounds:
        """Return the rows of the pairs that have to brake first.

        What moves cannot stop at once at the torque level, and of far pairs some close fast. All
        that could not stop in time without a row get one, more than ``pairs`` if need be.
        """
        law, able, slowest = self.braking, self._joint_acceleration, 0.0
        if not len(self.model.pairs):
            return self.rows(snapshot, dt)
        if able is not None:
            slowest = float((np.abs(snapshot.v[BASE_NV:]) / able).max(initial=0.0))
        closing = Closing(dt, law.deceleration, law.gain, slowest)
        found, left = self.model.soonest(snapshot, self.count, self._kept, closing)
        return self._rows(self._distances(snapshot, found, float(left.max())), dt)

    def has_more(self, distances: Distances) -> bool:
        """Whether there are pairs without rows."""
        return distances.keys.size < len(self.model.pairs)

    def watched(self) -> WatchedPairs | None:
        """Return what the native core needs to make the rows; None: it does not know the bodies."""
        model = self.model
        if model.native is None or not len(model.pairs):
            return None
        law = self.count, self._joint_acceleration, self.braking
        return WatchedPairs(model.native, self._kept, model.shorter, *law)

    def symbolic_rows(self, posture: SymbolicPosture) -> SeparatedPairs:
        """Return all pairs."""
        return SeparatedPairs(self.model, self._kept, {})

    def labels(self, distances: Distances) -> tuple[str, ...]:
        """Return labels such as ``"left_hand vs pelvis"``."""
        every = self.model.labels
        return every if distances.keys.size == len(every) else take(every, distances.keys)

    def curvature_bound(self, distances: Distances, step: Array) -> Array:
        """See :meth:`wbc.robot.collision.CollisionModel.tight_curvature_bound`."""
        if distances.found is None:
            return self.model.curvature_bound(distances.keys, step)
        left = distances.clearance + distances.jacobian @ step
        left += USED
        return self.model.tight_curvature_bound(distances.found, step, left)
