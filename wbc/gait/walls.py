"""Walls and rails that hands can lean on, the hands, and whether one reaches the other."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.gait.arms import Arm
from wbc.kinds import check_word
from wbc.robot import Snapshot
from wbc.validate import Array, check_fields, finite_array, list_of, read_only, set_fields

WALL_THICKNESS = 0.1  # m
MIN_HORIZONTAL = 0.1  # horizontal part of a wall's unit normal: a flatter face is ground
# Largest lean towards a wall [rad], about 30 degrees: a robot that leans more is not caught by any
# hand. It brings the shoulder nearer by as many heights of the CoM.
MAX_LEAN = 0.5


@dataclass(frozen=True, eq=False)
class Wall:
    """A flat face that hands can press on: a rectangle, its lower and upper side level.

    Attributes
    ----------
    point:
        Middle of the face (3,) [m], world axes.
    normal:
        (3,) out of the face; any length, then of unit length.
    size:
        Width and height (2,) [m], by default 4 x 2; a rail is a low one.
    friction:
        Coefficient of friction; a hand leans on no wall that has none.
    """

    point: Array
    normal: Array
    size: Array = (4.0, 2.0)  # type: ignore[assignment]
    friction: float = 0.6

    if TYPE_CHECKING:  # array-likes are given, arrays are read

        def __init__(
            self, point: ArrayLike, normal: ArrayLike, size: ArrayLike = ..., friction: float = ...
        ) -> None: ...

    def __post_init__(self) -> None:
        normal = finite_array("wall, normal", self.normal, (3,))
        length = float(np.linalg.norm(normal))
        if length == 0.0:
            raise InvalidInputError(
                "wall, normal: needs some length: it points out of the face, towards the robot"
            )
        if float(np.linalg.norm(normal[:2])) <= MIN_HORIZONTAL * length:
            raise InvalidInputError(
                f"wall, normal: {normal.tolist()} is not horizontal; what lies flat is a step of"
                " the terrain"
            )
        set_fields(
            self,
            point=read_only(finite_array("wall, point", self.point, (3,))),
            normal=read_only(normal / length),
            size=read_only(finite_array("wall, size", self.size, (2,))),
        )
        if (self.size <= 0.0).any():
            raise InvalidInputError(f"wall, size: must be positive, got {self.size.tolist()}")
        check_fields(self, "wall, ", "friction", above=0.0)

    @property
    def rotation(self) -> Array:
        """Its axes (3, 3) in the world, as columns: the normal, along its width, and upwards."""
        along = np.array((-self.normal[1], self.normal[0], 0.0))
        along /= np.linalg.norm(along)
        return np.column_stack((self.normal, along, np.cross(self.normal, along)))

    def distance(self, point: Array) -> float:
        """Return how far a point (3,) is in front of the face's plane [m]; negative behind."""
        return float(self.normal @ (point - self.point))

    def gap(self, middle: Array, radius: float) -> float:
        """Return how far a ball around a point (3,) is in front of the face [m].

        Negative inside or behind it; infinite for a ball beside the face, above a rail say. One in
        front of an edge touches that.
        """
        beside, ahead = self.beside(middle), self.distance(middle)
        if beside == 0.0:
            return ahead - radius
        return math.hypot(beside, ahead) - radius if beside < radius and ahead > 0.0 else math.inf

    def beside(self, point: Array) -> float:
        """Return how far a point (3,) is beside the face, along it [m]; 0 in front and behind."""
        local = np.abs((point - self.point) @ self.rotation[:, 1:])
        return math.hypot(*np.maximum(local - 0.5 * self.size, 0.0).tolist())

    def touched(self, point: Array, radius: float) -> Array:
        """Return the centre (3,) of a ball on the face that is nearest to a point (3,) [m].

        The ball stays within the face's sides, or is in the middle of a face that is too small.
        """
        R = self.rotation
        half = np.maximum(0.5 * self.size - radius, 0.0)
        local = (point - self.point) @ R[:, 1:]
        return self.point + R[:, 1:] @ np.clip(local, -half, half) + radius * self.normal


@dataclass(frozen=True)
class Hand:
    """A hand that leans on walls: a ball around a frame's origin.

    Attributes
    ----------
    frame:
        A link or frame at the end of an arm.
    radius:
        Of the ball [m].
    """

    frame: str
    radius: float = 0.03

    def __post_init__(self) -> None:
        check_word("hand, frame", self.frame)
        check_fields(self, "hand, ", "radius", above=0.0)


def check_hands(what: str, hands: Sequence[Hand]) -> tuple[Hand, ...]:
    """Return a list of hands as a tuple.

    Raises InvalidInputError: something else, or two hands at one frame.
    """
    checked = list_of(f"{what}, hands", hands, Hand, 'Hand("left_rubber_hand")')
    frames = [hand.frame for hand in checked]
    for frame in frames:
        if frames.count(frame) > 1:
            raise InvalidInputError(f"{what}, hands: {frame!r} is named twice")
    return checked


def check_walls(what: str, walls: Sequence[Wall]) -> tuple[Wall, ...]:
    """Return a list of walls as a tuple; :class:`~wbc.errors.InvalidInputError` if it is none."""
    return list_of(f"{what}, walls", walls, Wall, "Wall(point, normal)")


def check_reach(
    walls: Sequence[Wall], arms: Mapping[Hand, Arm], start: Snapshot, touch: float
) -> None:
    """Refuse walls that no hand can reach, or that the robot is in or behind.

    ``touch`` is the distance from a wall that counts as contact [m].

    Raises InvalidInputError: the message names the wall, and the hand.
    """
    heights = [start.position(foot.frame)[2] for foot in start.robot.feet.values()]
    lean = MAX_LEAN * float(start.com[2] - min(heights, default=0.0))
    for k, wall in enumerate(walls):
        behind = -wall.distance(start.com)
        if behind > 0.0:
            raise InvalidInputError(
                f"hand support: the CoM is {behind:.2f} m behind wall {k} at the start; its normal"
                " points at the robot"
            )
        spare = dict[str, float]()
        for hand, arm in arms.items():
            gap = wall.gap(start.position(hand.frame), hand.radius)
            if gap < touch:
                raise InvalidInputError(
                    f"hand support: wall {k} is {1e3 * gap:.0f} mm from {hand.frame!r} at the"
                    " start, or behind it; its normal points at the robot, and there is room"
                )
            shoulder = start.position(arm.shoulder)
            goal = wall.touched(shoulder, hand.radius)
            distance = math.dist(goal, shoulder)
            spare[hand.frame] = arm.length + lean - distance
        nearest = max(spare, key=lambda name: spare[name])
        if spare[nearest] < 0.0:
            raise InvalidInputError(
                f"hand support: wall {k} is out of reach of {', '.join(spare)}, by"
                f" {-spare[nearest]:.2f} m for {nearest!r} even if the robot leans by"
                f" {math.degrees(MAX_LEAN):.0f} degrees; move it, or leave it out"
            )
