"""Settings and states of hands that lean on walls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from wbc.constraints import PointContact
from wbc.errors import InvalidInputError
from wbc.gait.swing import SwingMotion
from wbc.gait.walls import Hand, Wall
from wbc.validate import Array, check_fields


@dataclass(frozen=True)
class LeanSettings:
    """When hands reach for walls, how, and when they let go.

    Attributes
    ----------
    begin:
        Distance of the capture point from the edge of the soles, inside, at which a hand reaches
        [m]. Soles may suffice for one that stays inside, but throw the trunk for that: with 0 a G1
        that was pushed towards a wall in front by 1.5 M omega d hit it with its head, its capture
        point 13 mm inside; with 20 mm it stood.
    end:
        Distance inside of all edges at which the hand is released [m]; more than ``begin``. When
        only the edge towards the wall counted, a G1 pushed by 2.1 M omega d fell backwards along
        the wall afterwards.
    below:
        How far below the shoulder the hand touches, in parts of the arm's length.
    touch:
        Distance from the wall that counts as contact [m].
    late:
        Speed of a hand that has not touched the wall in time [m/s].
    ramp:
        How long the wall's force ramps up and down [s].
    weight, stiffness:
        Of the reaching hand [1/(m/s)], and its ``kp`` [1/s^2].
    axis:
        Weight of the hand's direction, at the wall; its stiffness is that of the hand.
    trunk, stiff_trunk:
        Weight [1/(rad/s)] and ``kp`` [1/s^2] of the trunk meanwhile.
    """

    begin: float = 0.02
    end: float = 0.04
    below: float = 0.1
    touch: float = 3e-3
    late: float = 0.4
    ramp: float = 0.02
    weight: float = 10.0
    stiffness: float = 900.0
    axis: float = 1.0
    trunk: float = 10.0
    stiff_trunk: float = 100.0

    def __post_init__(self) -> None:
        check_fields(self, "hands, ", "below")
        check_fields(self, "hands, ", "begin", "end", "ramp", least=0.0)
        if self.end <= self.begin:
            raise InvalidInputError(
                f"hands, end: {self.end:g} m is not farther inside than begin ({self.begin:g} m):"
                " a hand that is released would reach again"
            )
        positive = ("touch", "late", "weight", "stiffness", "axis", "trunk", "stiff_trunk")
        check_fields(self, "hands, ", *positive, above=0.0)


class HandsFree(NamedTuple):
    """No hand is needed."""


class Reaching(NamedTuple):
    """A hand is on its way to a wall."""

    hand: Hand
    wall: Wall
    motion: SwingMotion  # reference of its frame's origin (3,) [m]
    left: float  # time until the planned contact [s]; negative if late


class Leaning(NamedTuple):
    """A hand has been on a wall for ``time`` [s]."""

    hand: Hand
    wall: Wall
    contact: PointContact
    time: float = 0.0


class Withdrawing(NamedTuple):
    """A hand leaves a wall; ``left`` is the remaining time of its retreat [s]."""

    hand: Hand
    wall: Wall
    motion: SwingMotion
    goal: Array
    left: float
