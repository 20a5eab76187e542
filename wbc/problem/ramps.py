"""Targets that move smoothly from where they are to where they should be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from wbc.minimum_jerk import minimum_jerk, minimum_jerk_rates
from wbc.problem.spaces import VECTORS, Space
from wbc.validate import Array

# Takes a target's value, rate and acceleration.
HandOver = Callable[[Array, Array, Array], None]


@dataclass(frozen=True, eq=False)
class MinimumJerk:
    """The path from ``start`` to ``end`` in ``duration`` [s] of least integrated squared jerk.

    s(x) = 10 x^3 - 15 x^4 + 6 x^5 with x = t / duration: rate and acceleration are zero at both
    ends and continuous everywhere (Flash and Hogan 1985). In another space than that of plain
    vectors, s is the part of the way that is done.
    """

    start: Array
    end: Array
    duration: float
    space: Space = VECTORS

    @cached_property
    def way(self) -> Array:
        """The whole way, as a vector."""
        return self.space.difference(self.start, self.end)

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Return value, rate and acceleration at ``t`` [s]; at rest before 0 and after the end.

        Rate and acceleration are those along :attr:`way`.
        """
        x = min(max(t / self.duration, 0.0), 1.0)
        slope, bend = minimum_jerk_rates(x)
        speed, push = slope / self.duration, bend / self.duration**2
        # Written from the end, so that the end is met exactly.
        value = self.space.moved(self.end, -(1.0 - minimum_jerk(x)) * self.way)
        return value, speed * self.way, push * self.way


@dataclass(frozen=True, eq=False)
class MovingTarget:
    """A ramp that starts at ``begins`` [s], and what takes its value, rate and acceleration."""

    ramp: MinimumJerk
    hand_over: HandOver
    begins: float = 0.0

    def move_to(self, t: float) -> None:
        """Set what is moved to its value at time ``t`` [s]."""
        self.hand_over(*self.ramp.at(t - self.begins))
