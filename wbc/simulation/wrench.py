"""Wrenches that act on a simulated robot for longer: a rope, a tool that presses, a wind."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from wbc.kinds import check_switches, check_word
from wbc.validate import Array, check_fields, finite_array, read_only, set_fields

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
