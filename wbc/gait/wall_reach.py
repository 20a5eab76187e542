"""Whether walls are where hands can lean on them, before anything moves."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from wbc.errors import InvalidInputError
from wbc.gait.arms import Arm
from wbc.gait.walls import Hand, Wall
from wbc.robot import Snapshot

# How far the shoulder may come nearer to a wall, in parts of the CoM's height: a robot that leans
# by 30 degrees is not caught by any hand.
LEAN = 0.5


def check_reach(
    walls: Sequence[Wall], arms: Mapping[Hand, Arm], start: Snapshot, touch: float
) -> None:
    """Refuse walls that no hand can reach, or that are where the robot is.

    ``touch`` is how far before a wall a hand touches it [m].

    Raises
    ------
    InvalidInputError
        The message names the wall, and the hand.
    """
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
            way = math.dist(goal, shoulder)
            spare[hand.frame] = arm.length + LEAN * float(start.com[2]) - way
        nearest = max(spare, key=lambda name: spare[name])
        if spare[nearest] < 0.0:
            raise InvalidInputError(
                f"hand support: wall {k} is out of reach of {', '.join(spare)}, by"
                f" {-spare[nearest]:.2f} m for {nearest!r} even if the robot leans by"
                f" {math.degrees(LEAN):.0f} degrees; move it, or leave it out"
            )
