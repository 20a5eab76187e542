"""Obstacles: the robot's bodies kept clear of what stands or moves around it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wbc.constraints.bodies import BodyMargin
from wbc.constraints.limits import Limits
from wbc.constraints.margin import SKIN, BrakingParameters
from wbc.constraints.rows import Distances, SeparatedPairs
from wbc.errors import InvalidInputError
from wbc.robot import Robot, Snapshot
from wbc.robot.collision import Body, CollisionModel, Obstacle, PairDistances, fitted_bodies
from wbc.robot.names import matching
from wbc.validate import Array, clearance, names_of

if TYPE_CHECKING:
    from wbc.robot.symbolic import SymbolicPosture


class Obstacles(BodyMargin):
    """Keep the robot's bodies ``margin`` away from obstacles.

    The obstacle's own velocity (see :class:`~wbc.robot.collision.Obstacle`) counts: the faster it
    comes, the more slowly the robot may approach it. Where it is so fast or so near that standing
    still is not enough, the row is relaxed to ``C v >= 0`` (the robot does not approach it), and a
    cost that outweighs the tasks asks for the velocity that is missing. So the robot gets out of
    the way as far as contacts and limits let it, and no obstacle can make the QP infeasible.

    Parameters
    ----------
    obstacles:
        Any number. Their places are read at every tick, their shapes once.
    margin:
        Distance that is kept [m].
    pairs:
        How many pairs of a body and an obstacle get a row in each tick: see
        :class:`~wbc.constraints.bodies.BodyMargin`.
    links:
        Patterns of the links that must keep clear. Leave out the feet if one of the obstacles is
        the floor they stand on.
    fit:
        What meshes are replaced by: ``"capsule"`` or, closer and slower, ``"hull"``.
    braking, limits:
        See :class:`~wbc.constraints.margin.Margin`.

    Raises
    ------
    ModelError
        A mesh is missing, or the robot has no collision shapes.
    UnknownNameError
        A pattern that matches no link.
    InvalidInputError
        No obstacles, or two of one name.
    """

    margin: float
    obstacles: tuple[Obstacle, ...]

    _fixed = dict.fromkeys(("obstacles", "model"), "make other Obstacles")

    def __init__(
        self,
        robot: Robot,
        obstacles: Sequence[Obstacle],
        *,
        margin: float = 0.02,
        pairs: int = 25,
        links: Iterable[str] = ("*",),
        fit: str = "capsule",
        braking: BrakingParameters | None = None,
        limits: Limits | None = None,
    ) -> None:
        super().__init__(robot, "obstacles", pairs, braking, limits)
        self.margin = margin
        listed = tuple(obstacles) if isinstance(obstacles, Iterable) else (None,)
        if not all(isinstance(one, Obstacle) for one in listed):
            raise InvalidInputError(f"obstacles: expected a list of Obstacle, got {obstacles!r}")
        if not listed:
            raise InvalidInputError("obstacles: none given; name at least one, or leave this out")
        names_of("obstacles", [one.name for one in listed])
        self.obstacles = listed
        own = _bodies_of(fitted_bodies(robot, fit), links)
        around = [Body(one.name, one.name, 0, one.shape) for one in self.obstacles]
        self._first = len(own)
        self.model = CollisionModel(
            robot,
            (*own, *around),
            [(b, self._first + k) for k in range(len(around)) for b in range(len(own))],
        )

    def _set_attribute(self, name: str, value: Any) -> None:
        if name == "margin":
            value = clearance("obstacles", value)
        super()._set_attribute(name, value)

    def min_distances(self) -> Array:
        """Return the least distance (N,) of each pair [m], skin included."""
        return np.full(len(self.model.pairs), self.margin + SKIN)

    def place(self) -> None:
        """Move the obstacles' bodies to their present poses."""
        for k, one in enumerate(self.obstacles, self._first):
            moving = one.velocity, one.angular_velocity
            self.model.place(k, one.rotation, one.origin, *moving)

    def to_distances(
        self, snapshot: Snapshot, found: PairDistances, beyond: float | None = None
    ) -> Distances:
        """Return measured pairs as distances, and the rates at which obstacles change them."""
        model, clearance = self.model, found.distance - (self.margin + SKIN)
        rates = model.rates(found)
        return Distances(found.pairs, clearance, model.rows(snapshot, found), rates, found, beyond)

    def symbolic_rows(self, posture: SymbolicPosture) -> SeparatedPairs:
        """Return all pairs, with the obstacles where they are now.

        Raises
        ------
        InvalidInputError
            An obstacle moves: where it will be at the end is not known.
        """
        for one in self.obstacles:
            if one.velocity.any() or one.angular_velocity.any():
                raise InvalidInputError(
                    f"global shaping: obstacle {one.name!r} moves, and the search is for a posture"
                    " to rest in; give it no velocity and no spin, or leave it to the controller"
                    " that moves there"
                )
        places = {
            k: (one.rotation, one.origin) for k, one in enumerate(self.obstacles, self._first)
        }
        return SeparatedPairs(self.model, self.margin + SKIN, places)


def _bodies_of(bodies: Sequence[Body], patterns: Iterable[str]) -> tuple[Body, ...]:
    """Return the bodies of the links that match a pattern."""
    links = tuple(dict.fromkeys(body.link for body in bodies))
    wanted = {links[k] for pattern in patterns for k in matching(pattern, links, "link")}
    if not wanted:
        raise InvalidInputError("obstacles, links: no pattern given; no body would keep clear")
    return tuple(body for body in bodies if body.link in wanted)
