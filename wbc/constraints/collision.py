"""Avoidance of self-collisions."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from wbc.constraints.bodies import BodyMargin
from wbc.constraints.limits import Limits
from wbc.constraints.margin import SKIN, BrakingParameters
from wbc.constraints.rows import Distances, SeparatedPairs
from wbc.errors import InvalidInputError, listed
from wbc.kinds import check_kind
from wbc.robot import Robot, Snapshot
from wbc.robot.collision import CollisionModel, PairDistances, chosen_pairs
from wbc.robot.collision.native_pairs import NativePairs
from wbc.robot.collision.pairs import BY_DESCRIPTION
from wbc.validate import Array, clearance, read_only

if TYPE_CHECKING:
    from wbc.robot.symbolic import SymbolicPosture

NO_SHAPES = "no collision shapes"


class WatchedPairs(NamedTuple):
    """A self-collision constraint's data for the native core."""

    pairs: NativePairs
    min_distances: Array  # (N,) least distance of each pair, skin included [m]
    rows: int  # number of pairs with a row
    acceleration: Array | None  # (nv - 6,) of the joints, assumed for braking, or None
    braking: BrakingParameters


class SelfCollision(BodyMargin):
    """Keep the robot's bodies ``margin`` apart.

    Parameters
    ----------
    margin:
        Least distance [m].
    pairs:
        Number of pairs with a row in each tick: see :class:`~wbc.constraints.bodies.BodyMargin`.
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
        (N,) least distance of each pair of the model [m]: ``margin``, or half of the distance when
        standing, if that is less.
    excluded:
        Pairs that are not checked, and why.
    finer:
        Pairs with finer shapes than those of ``fit``, and their distances when standing.
    unseen:
        If most joints' links have no collision shapes in the file: these links, and why they are
        not checked; else empty.

    Raises
    ------
    ModelError
        A mesh is missing, or the robot has no collision shapes.
    UnknownNameError
        A pattern that matches no link.
    """

    margin: float
    margins: Array
    excluded: dict[str, str]
    finer: dict[str, str]
    unseen: dict[str, str]

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
        super().__init__(robot, "self-collision", pairs, braking, limits)
        check_kind("self-collision, model", model, CollisionModel, or_none=True)
        self.margin = clearance("self-collision", margin)
        self.excluded: dict[str, str] = {}
        self.finer: dict[str, str] = {}
        self.unseen: dict[str, str] = {}
        margins: Sequence[float] = ()
        if model is not None and ([*include], [*exclude], fit) != ([], [], "capsule"):
            raise InvalidInputError(
                "self-collision: a model has its bodies and pairs already; leave out include,"
                " exclude and fit, or the model"
            )
        if model is None:
            chosen = chosen_pairs(
                robot, fit, include=include, exclude=exclude, clearance=self.margin
            )
            model = CollisionModel(robot, chosen.bodies, chosen.pairs)
            margins = chosen.margins
            self.excluded, self.finer = dict(chosen.excluded), dict(chosen.finer)
            self.unseen = _joints_without_shapes(robot, {body.joint for body in chosen.bodies})
        self.margins = read_only(np.array(margins or [self.margin] * len(model.pairs)))
        self._min_distances = self.margins + SKIN
        if model.robot is not robot:
            raise InvalidInputError("self-collision: the model was made for another robot object")
        self.model = model

    @property
    def in_contact(self) -> dict[str, str]:
        """Pairs that are not checked although the user did not exclude them, with the reason."""
        return {pair: why for pair, why in self.excluded.items() if why not in BY_DESCRIPTION}

    def min_distances(self) -> Array:
        """Return the least distance (N,) of each pair [m], skin included."""
        return self._min_distances

    def to_distances(
        self, snapshot: Snapshot, found: PairDistances, beyond: float | None = None
    ) -> Distances:
        """Return measured pairs as distances."""
        clearance, rows = found.distance - self._min_distances.take(found.pairs), self.model.rows
        return Distances(found.pairs, clearance, rows(snapshot, found), None, found, beyond)

    def watched(self) -> WatchedPairs | None:
        """Return the data for the native core, or None if there are no pairs."""
        model = self.model
        if not len(model.pairs):
            return None
        law = self.count, self._joint_acceleration, self.braking
        return WatchedPairs(model.native, self._min_distances, *law)

    def symbolic_rows(self, posture: SymbolicPosture) -> SeparatedPairs:
        """Return all pairs."""
        return SeparatedPairs(self.model, self._min_distances, {})


def _joints_without_shapes(robot: Robot, seen: set[int]) -> dict[str, str]:
    """Return links that are not checked, and why, if most joints' links have no shapes."""
    joints = [*enumerate(robot.model.names)][2:]  # after the world and the base
    unseen = [str(name) for joint, name in joints if joint not in seen]
    if 2 * len(unseen) <= len(joints):
        return {}
    told = f"what {len(unseen)} of {len(joints)} joints move ({listed(unseen, 3)})"
    logging.getLogger(__name__).warning(
        "self-collision: %s: %s is not kept apart: %s", robot.name, told, NO_SHAPES
    )
    return {told: NO_SHAPES}
