"""What is found out about a robot once, whatever motion it is given."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple
from weakref import WeakKeyDictionary

from wbc.constraints import BrakingParameters, SelfCollision
from wbc.errors import ModelError
from wbc.gait.legs import Legs
from wbc.retargeting.body_map import BodyMap, body_map
from wbc.retargeting.scaling import StandingBody, standing_of
from wbc.robot import Robot
from wbc.validate import by_name

APART = "bodies are not kept apart"  # as a note begins that says why
# Targets do not run into margins: what comes near one is on its way past it.
BRAKING = BrakingParameters(deceleration=50.0, gain=1.0)


class Prepared(NamedTuple):
    """A robot's legs, its parts, how it stands, and the margins between its bodies, if wanted."""

    legs: Legs
    body: BodyMap
    standing: StandingBody
    collision: SelfCollision | None
    notes: tuple[str, ...]  # why bodies are not kept apart, if they should be


_Key = tuple[tuple[tuple[str, str], ...], float | None]
_known: WeakKeyDictionary[Robot, dict[_Key, Prepared]] = WeakKeyDictionary()


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
    key = tuple(sorted(given.items())), margin
    every = _known.setdefault(robot, {})
    if key not in every:
        legs, body = Legs.of(robot), body_map(robot, given)
        collision, notes = None, tuple[str, ...]()
        if margin is not None:
            try:
                collision = SelfCollision(robot, margin=margin, braking=BRAKING)
            except ModelError as error:  # shapes that are not there, most of all
                notes = (f"{APART}: {error}",)
        standing = standing_of(robot, legs, body)
        every[key] = Prepared(legs, body, standing, collision, notes)
    return every[key]
