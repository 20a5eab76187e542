"""Pushes, a force on one body for a while, and lasting wrenches, as of a rope or wind."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wbc.kinds import check_switches, check_word, one_of
from wbc.robot import Robot, Snapshot
from wbc.validate import Array, check_fields, finite_array, read_only, set_fields

COM = "com"
PROFILES = ("rectangular", "half_sine")
ORIGIN = np.zeros(3)
DIGITS = 9  # of the part of a period in which a wrench acts: times are sums of many steps


@dataclass(frozen=True, eq=False)
class Push:
    """A force (3,) in world axes on a point that moves with a frame.

    Attributes
    ----------
    body:
        A frame or link of the robot.
    force:
        Largest force (3,) [N], world axes.
    point:
        Point of application (3,) [m], in the frame's axes from its origin.
    start, duration:
        In simulated time [s].
    profile:
        ``rectangular``, or ``half_sine``, whose impulse is 2/pi of the former's.
    """

    body: str
    force: Array
    point: Array
    start: float
    duration: float
    profile: str = "rectangular"

    def __post_init__(self) -> None:
        set_fields(
            self,
            force=read_only(finite_array("push, force", self.force, (3,))),
            point=read_only(finite_array("push, point", self.point, (3,))),
        )
        check_fields(self, "push, ", "start")
        check_fields(self, "push, ", "duration", above=0.0)
        check_word("push, body", self.body)
        one_of("profile of a push", self.profile, PROFILES)

    @property
    def end(self) -> float:
        """End of the push [s]."""
        return self.start + self.duration

    @property
    def impulse(self) -> Array:
        """Time integral of the force (3,) [N s]."""
        return self.force * self.duration * self._share(0.0, 1.0)

    def mean(self, time: float, dt: float) -> Array:
        """Return the mean force [N] from ``time`` to ``time + dt``, as a wrench (6,).

        Held over physics steps of any size, these give the exact impulse.
        """
        begin, end = ((t - self.start) / self.duration for t in (time, time + dt))
        share = self._share(min(max(begin, 0.0), 1.0), min(max(end, 0.0), 1.0))
        return np.append(self.force * (share * self.duration / dt), np.zeros(3))

    def _share(self, begin: float, end: float) -> float:
        """Return the integral of the profile, whose peak is 1, over a part of [0, 1]."""
        if self.profile == "rectangular":
            return end - begin
        return (math.cos(np.pi * begin) - math.cos(np.pi * end)) / np.pi


def push_point(point: ArrayLike | str | None, body: str, snapshot: Callable[[], Snapshot]) -> Array:
    """Return a push's point of application (3,), in the body's axes from its origin [m].

    Raises UnknownNameError: a word that is not ``com``; InvalidInputError: not three finite
    numbers.
    """
    if point is None:
        return np.zeros(3)
    if isinstance(point, str):
        one_of("point of a push", point, [COM])
        s = snapshot()
        return s.rotation(body).T @ (s.com - s.position(body))
    return finite_array("push, point", point, (3,))


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

    ``bodies``: MuJoCo's body of each Pinocchio joint.
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
