"""What retargeting derives from a robot alone, cached for the last few robots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

from wbc.constraints import BrakingParameters, SelfCollision
from wbc.errors import ModelError
from wbc.gait.legs import Legs, knees_one_way
from wbc.retargeting.body_map import BodyMap, body_map
from wbc.retargeting.fingers import FixedFingers
from wbc.retargeting.scaling import StandingBody, standing_body
from wbc.robot import Robot
from wbc.validate import by_name

NO_SELF_COLLISION = "bodies are not kept apart"  # begins the note that says why
# Targets do not run into margins, so a body near one may pass it fast.
BRAKING = BrakingParameters(deceleration=50.0, gain=1.0)


class RobotSetup(NamedTuple):
    """The robot with fixed fingers, its legs, body map, standing body and margins, if wanted."""

    fingers: FixedFingers
    legs: Legs
    body: BodyMap
    standing: StandingBody
    collision: SelfCollision | None
    notes: tuple[str, ...]  # fixed fingers, and why there is no self-collision where it was wanted

    @property
    def robot(self) -> Robot:
        """With fixed fingers."""
        return self.fingers.robot


def robot_setup(robot: Robot, links: Mapping[str, str] | None, margin: float | None) -> RobotSetup:
    """Return what is derived from a robot, from a cache if possible.

    Parameters
    ----------
    links:
        See :func:`wbc.retargeting.body_map.body_map`, whose errors it raises.
    margin:
        Between bodies [m]; None: they may touch.
    """
    given = {} if links is None else dict(by_name("retarget, links", links))
    return _cached_setup(robot, tuple(sorted(given.items())), margin)


@lru_cache(maxsize=8)
def _cached_setup(
    robot: Robot, links: tuple[tuple[str, str], ...], margin: float | None
) -> RobotSetup:
    body = body_map(robot, dict(links))
    fingers = FixedFingers.of(robot, body)
    legs, collision, notes = Legs.of(fingers.robot), None, fingers.notes
    fingers = replace(fingers, robot=knees_one_way(fingers.robot))
    if margin is not None:
        try:
            collision = SelfCollision(fingers.robot, margin=margin, braking=BRAKING)
        except ModelError as error:  # missing shapes, most of all
            notes += (f"{NO_SELF_COLLISION}: {error}",)
    standing = standing_body(fingers.robot, legs, body)
    return RobotSetup(fingers, legs, body, standing, collision, notes)
