"""When hands reach for walls, and how far they have got."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from wbc.constraints import PointContact
from wbc.errors import InvalidInputError
from wbc.gait.arms import Arm
from wbc.gait.swing import SwingMotion
from wbc.gait.walls import Hand, Wall
from wbc.validate import Array, check_fields


@dataclass(frozen=True)
class LeanSettings:
    """When hands reach for walls, how, and when they let go.

    Attributes
    ----------
    begin:
        How near the capture point is to the edge of the soles, inside, when a hand reaches [m].
        Soles may suffice for one that stays inside, but throw the trunk for that: a G1 that was
        pushed towards a wall in front by 1.5 M omega d met it with its head at 0, its capture
        point 13 mm inside, and stood with 20 mm.
    end:
        How far inside, from all edges, it is when the hand is released [m]; more than ``begin``.
        A G1 that was held by its hand until it was so far from the edge towards the wall alone fell
        backwards along the wall afterwards, pushed by 2.1 M omega d.
    below:
        How far below the shoulder the hand touches, in parts of the arm's length.
    touch:
        Distance from the wall at which the hand is taken to touch it [m].
    late:
        Speed at which a hand goes on that has not met the wall in time [m/s].
    ramp:
        How long the wall's force takes to come and to go [s].
    weight, stiffness:
        Of the hand in the air [1/(m/s)], and its ``kp`` [1/s^2].
    axis:
        Weight of the hand's pointing at the wall; its stiffness is that of the hand.
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
    """A hand is on its way to a wall.

    Attributes
    ----------
    motion:
        Of its frame's origin (3,), as it should be [m].
    left:
        Until it should touch [s]; negative: it is late.
    """

    arm: Arm
    hand: Hand
    wall: Wall
    motion: SwingMotion
    left: float


class Leaning(NamedTuple):
    """A hand is on a wall, for ``time`` [s] by now."""

    arm: Arm
    hand: Hand
    wall: Wall
    contact: PointContact
    time: float = 0.0


class Withdrawing(NamedTuple):
    """A hand leaves a wall; ``left`` [s] until it is left to the posture, and then to rest."""

    hand: Hand
    wall: Wall
    motion: SwingMotion
    goal: Array
    left: float
