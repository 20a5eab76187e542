"""Wrenches that act on a simulated robot for longer, as a rope or a wind; what acts, in MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wbc.kinds import check_switches, check_word
from wbc.robot import Robot
from wbc.simulation.push import Push
from wbc.validate import Array, check_fields, finite_array, read_only, set_fields

ORIGIN = np.zeros(3)
DIGITS = 9  # of the part of a period in which a wrench acts: times are sums of many steps


@dataclass(frozen=True, eq=False)
class AppliedWrench:
    """A constant wrench (6,) at a frame's origin, world axes, [N] then [N m].

    Attributes
    ----------
    frame:
        A frame or link of the robot, whose origin carries it along.
    wrench:
        (6,) on the robot.
    start, duration:
        When it begins, in simulated time, and how long it lasts [s]; infinite for ever.
    told:
        Whether :func:`wbc.simulation.simulate` tells the controller of it.
    """

    frame: str
    wrench: Array
    start: float = 0.0
    duration: float = math.inf
    told: bool = True

    def __post_init__(self) -> None:
        set_fields(self, wrench=read_only(finite_array("wrench", self.wrench, (6,))))
        check_fields(self, "wrench, ", "start", least=0.0)
        check_fields(self, "wrench, ", "duration", above=0.0, unlimited=True)
        check_word("wrench, frame", self.frame)
        check_switches(self, "wrench, ", "told")

    @property
    def end(self) -> float:
        """When it is over [s]."""
        return self.start + self.duration

    def mean(self, time: float, dt: float) -> Array:
        """Return its mean (6,) from ``time`` to ``time + dt``."""
        acts = min(time + dt, self.end) - max(time, self.start)
        return self.wrench * round(min(max(acts / dt, 0.0), 1.0), DIGITS)


def sum_by_frame(wrenches: Iterable[AppliedWrench], time: float, dt: float) -> dict[str, Array]:
    """Return the mean of what acts from ``time`` to ``time + dt``, the sum (6,) by frame."""
    found: dict[str, Array] = {}
    for one in wrenches:
        mean = one.mean(time, dt)
        if mean.any():
            found[one.frame] = found[one.frame] + mean if one.frame in found else mean
    return found


def apply(
    acting: Sequence[Push | AppliedWrench],
    robot: Robot,
    bodies: Sequence[int],
    data: Any,
    dt: float,
) -> Array:
    """Write what acts, its means over ``dt`` from now, as the forces in MuJoCo's data.

    Returns the sum of the pushes' forces (3,) [N].

    Parameters
    ----------
    bodies:
        MuJoCo's body of each Pinocchio joint.
    """
    data.xfrc_applied[:] = 0.0
    pushed = np.zeros(3)
    for one in acting:
        force, moment = np.split(one.mean(float(data.time), dt), 2)
        frame, point = (one.body, one.point) if isinstance(one, Push) else (one.frame, ORIGIN)
        here = robot.frame(frame)
        body = bodies[int(here.parentJoint)]
        local = np.array(here.placement.rotation) @ point
        local += here.placement.translation
        arm = data.xpos[body] + data.xmat[body].reshape(3, 3) @ local - data.xipos[body]
        data.xfrc_applied[body, :3] += force
        data.xfrc_applied[body, 3:] += moment + np.cross(arm, force)
        pushed += force * isinstance(one, Push)
    return pushed
