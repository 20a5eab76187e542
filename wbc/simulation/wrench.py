"""Lasting wrenches on a simulated robot, as of a rope or wind, and their application in MuJoCo."""

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
        A frame or link of the robot; the wrench moves with its origin.
    wrench:
        (6,) on the robot.
    start, duration:
        In simulated time [s]; the duration may be infinite.
    told:
        Whether the controller knows it (:func:`wbc.simulation.simulate`).
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
        """End of the wrench [s]."""
        return self.start + self.duration

    def mean(self, time: float, dt: float) -> Array:
        """Return its mean (6,) from ``time`` to ``time + dt``."""
        overlap = min(time + dt, self.end) - max(time, self.start)
        return self.wrench * round(min(max(overlap / dt, 0.0), 1.0), DIGITS)


def sum_by_frame(wrenches: Iterable[AppliedWrench], time: float, dt: float) -> dict[str, Array]:
    """Return the sums (6,) by frame of the means from ``time`` to ``time + dt``."""
    sums: dict[str, Array] = {}
    for one in wrenches:
        mean = one.mean(time, dt)
        if mean.any():
            sums[one.frame] = sums[one.frame] + mean if one.frame in sums else mean
    return sums


def apply(
    active: Sequence[Push | AppliedWrench],
    robot: Robot,
    bodies: Sequence[int],
    data: Any,
    dt: float,
) -> Array:
    """Add the mean wrenches over ``dt`` from now to those in MuJoCo's data.

    Returns the sum of the pushes' forces (3,) [N].

    Parameters
    ----------
    bodies:
        MuJoCo's body of each Pinocchio joint.
    """
    push_force = np.zeros(3)
    for one in active:
        force, moment = np.split(one.mean(float(data.time), dt), 2)
        frame, point = (one.body, one.point) if isinstance(one, Push) else (one.frame, ORIGIN)
        placed = robot.frame(frame)
        body = bodies[int(placed.parentJoint)]
        local = np.array(placed.placement.rotation) @ point
        local += placed.placement.translation
        arm = data.xpos[body] + data.xmat[body].reshape(3, 3) @ local - data.xipos[body]
        data.xfrc_applied[body, :3] += force
        data.xfrc_applied[body, 3:] += moment + np.cross(arm, force)
        push_force += force * isinstance(one, Push)
    return push_force
