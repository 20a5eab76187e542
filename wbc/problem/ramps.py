"""Targets that move smoothly from where the robot starts to where it should end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class MinimumJerk:
    """The path from ``start`` to ``end`` in ``duration`` [s] of least integrated squared jerk.

    s(x) = 10 x^3 - 15 x^4 + 6 x^5 with x = t / duration: rate and acceleration are zero at both
    ends and continuous everywhere (Flash and Hogan 1985).
    """

    start: Array
    end: Array
    duration: float

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Return value, rate and acceleration at ``t`` [s]; at rest before 0 and after the end."""
        x = min(max(t / self.duration, 0.0), 1.0)
        way = self.end - self.start
        along = x**3 * (10.0 + x * (6.0 * x - 15.0))
        speed = 30.0 * (x * (1.0 - x)) ** 2 / self.duration
        push = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / self.duration**2
        # Written from the end, so that the end is met exactly.
        return self.end - (1.0 - along) * way, speed * way, push * way


@dataclass(frozen=True, eq=False)
class MovingTarget:
    """A ramp, and what hands its value, rate and acceleration to a task."""

    ramp: MinimumJerk
    hand_over: Callable[[Array, Array, Array], None]

    def move_to(self, t: float) -> None:
        """Set the task's target to that of time ``t`` [s]."""
        self.hand_over(*self.ramp.at(t))
