"""What is found out about a robot once, whatever motion it is given; of the last few robots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

from wbc.constraints import BrakingParameters, SelfCollision
from wbc.errors import ModelError
from wbc.gait.legs import Legs, knees_one_way
from wbc.retargeting.body_map import BodyMap, body_map
from wbc.retargeting.fingers import FingersHeld
from wbc.retargeting.scaling import StandingBody, standing_of
from wbc.robot import Robot
from wbc.validate import by_name

APART = "bodies are not kept apart"  # as a note begins that says why
# Targets do not run into margins: what comes near one is on its way past it.
BRAKING = BrakingParameters(deceleration=50.0, gain=1.0)


class Prepared(NamedTuple):
    """What it moves as, its legs and parts, how it stands, and margins of its bodies, if wanted."""

    hands: FingersHeld
    legs: Legs
    body: BodyMap
    standing: StandingBody
    collision: SelfCollision | None
    notes: tuple[str, ...]  # what is held, and why bodies are not kept apart, if they should be


def prepared(robot: Robot, links: Mapping[str, str] | None, margin: float | None) -> Prepared:
    """Return what is known of a robot; the second time it takes no time.

    Parameters
    ----------
    links:
        See :func:`wbc.retargeting.body_map.body_map`, whose errors it raises.
    margin:
        Between bodies [m]; None: they may touch.
    """
    given = {} if links is None else dict(by_name("retarget, links", links))
    return _found_out(robot, tuple(sorted(given.items())), margin)


@lru_cache(maxsize=8)
def _found_out(robot: Robot, links: tuple[tuple[str, str], ...], margin: float | None) -> Prepared:
    body = body_map(robot, dict(links))
    hands = FingersHeld.of(robot, body)
    legs, collision, notes = Legs.of(hands.robot), None, hands.notes
    hands = replace(hands, robot=knees_one_way(hands.robot))
    if margin is not None:
        try:
            collision = SelfCollision(hands.robot, margin=margin, braking=BRAKING)
        except ModelError as error:  # shapes that are not there, most of all
            notes += (f"{APART}: {error}",)
    return Prepared(hands, legs, body, standing_of(hands.robot, legs, body), collision, notes)
