"""Pushes: a force on one body for a while."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wbc.kinds import check_word, one_of
from wbc.robot import Snapshot
from wbc.validate import Array, check_fields, finite_array, read_only, set_fields

COM = "com"
PROFILES = ("rectangular", "half_sine")


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

    Raises
    ------
    UnknownNameError
        A word that is not ``com``.
    InvalidInputError
        Not three finite numbers.
    """
    if point is None:
        return np.zeros(3)
    if isinstance(point, str):
        one_of("point of a push", point, [COM])
        s = snapshot()
        return s.rotation(body).T @ (s.com - s.position(body))
    return finite_array("push, point", point, (3,))
