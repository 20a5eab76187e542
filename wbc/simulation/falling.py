"""Detection of falls of a simulated robot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wbc.errors import InvalidInputError
from wbc.kinds import check_switches, check_word
from wbc.robot import Robot
from wbc.robot.names import BASE
from wbc.simulation.build import GROUND
from wbc.simulation.plant import Plant
from wbc.validate import check_fields


@dataclass(frozen=True)
class FallLimits:
    """Criteria of a fall; the first that is met counts.

    Attributes
    ----------
    com_height:
        The CoM is below this part of its initial height over the ground; not of robots that are
        bolted down or begin below it.
    tilt:
        The trunk has tilted from its initial vertical by more than this [rad].
    trunk:
        Frame of the trunk.
    touch:
        Anything touches the ground but a sole, or links beyond it, such as toes.
    lifted:
        Foot that must not touch down, of a robot that stands on the other one; empty: none.
    """

    com_height: float = 0.5
    tilt: float = 1.2
    trunk: str = BASE
    touch: bool = True
    lifted: str = ""

    def __post_init__(self) -> None:
        check_fields(self, "fall limits, ", "com_height", least=0.0)
        check_fields(self, "fall limits, ", "tilt", above=0.0)
        if self.tilt > math.tau:
            raise InvalidInputError(
                f"fall limits, tilt: {self.tilt:g} rad are more than a turn; {self.tilt:g} degrees"
                f" are {math.radians(self.tilt):.3g} rad, and 4 rad are never reached"
            )
        check_word("fall limits, trunk", self.trunk)
        check_word("fall limits, lifted", self.lifted, empty=True)
        check_switches(self, "fall limits, ", "touch")
        if self.com_height >= 1.0:
            raise InvalidInputError("fall limits, com_height: must be below 1")


class Verdict(NamedTuple):
    """Whether a robot stood until ``time`` [s], or why it fell then.

    ``tilt`` is the present angle of the trunk from its initial vertical [rad].
    """

    stood: bool
    time: float
    reason: str
    tilt: float = 0.0

    def __str__(self) -> str:
        return self.reason


def beyond_feet(robot: Robot) -> frozenset[str]:
    """Return the links beyond the feet in the kinematic tree, such as toes."""
    model = robot.model
    beyond = set[int]()
    feet = {int(robot.frame(foot.frame).parentJoint) for foot in robot.feet.values()}
    for joint in range(2, model.njoints):  # parents come first
        if int(model.parents[joint]) in feet | beyond:
            beyond.add(joint)
    return frozenset(str(frame.name) for frame in model.frames if frame.parentJoint in beyond)


class FallWatch:
    """Watches a plant for falls; made when the robot stands.

    Raises
    ------
    UnknownNameError
        No such trunk, or no such foot.
    """

    def __init__(self, plant: Plant, limits: FallLimits) -> None:
        self._plant, self.limits = plant, limits
        plant.robot.frame_id(limits.trunk)
        self._lifted = plant.robot.foot(limits.lifted).frame if limits.lifted else ""
        self._up = plant.body_rotation(limits.trunk)[2].copy()  # the vertical in the trunk's axes
        self._initial_height = self._height()
        self._can_sink = not plant.robot.fixed_base and self._initial_height > 0.0
        self._toes = beyond_feet(plant.robot)
        self._initial_touches = plant.touched()

    def verdict(self) -> Verdict:
        """Return the present verdict."""
        limits, plant = self.limits, self._plant
        upright = float(np.clip(plant.body_rotation(limits.trunk)[2] @ self._up, -1.0, 1.0))
        tilt = float(np.arccos(upright))
        height = self._height()
        reason = ""
        touched = plant.touched() if limits.touch else {}
        if links := [link for link in touched if link not in self._toes]:
            what = touched[links[0]]
            reason = f"{links[0]} touched {'the ground' if what == GROUND else what}"
            if self._initial_touches.get(links[0]) == what:
                reason += ", as at the start: the robot begins there; falls: {touch: false} lets it"
        elif self._lifted and plant.contact_forces[self._lifted][2] > 0.0:
            reason = f"the {limits.lifted} foot, which was lifted, touched the ground"
        elif tilt > limits.tilt:
            reason = f"{limits.trunk} tilted by {tilt:.2f} rad, more than {limits.tilt:g}"
        elif self._can_sink and height < limits.com_height * self._initial_height:
            reason = (
                f"the CoM sank to {height:.3f} m, below {limits.com_height:g} of"
                f" {self._initial_height:.3f} m"
            )
        if reason:
            return Verdict(False, plant.time, f"fell at t = {plant.time:.3f} s: {reason}", tilt)
        return Verdict(True, plant.time, f"stood for {plant.time:.3f} s", tilt)

    def _height(self) -> float:
        """Return the CoM's height over the plane of the ground [m]."""
        return float(self._plant.terrain.upright @ self._plant.com)
