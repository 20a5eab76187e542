"""When the loop's next tick is due: paced by the wall clock, paused, or one at a time."""

from __future__ import annotations

import math
import time

from wbc.errors import InvalidInputError
from wbc.validate import finite_number
from wbc.view.live.messages import Play, Request, Restart, Speed, StepRequest

MOST_DELAY = 0.1  # s: a loop that is later does not catch up


class Clock:
    """The pace of a loop that the user can pause.

    ``speed``: times real time; 0: as fast as can be.

    ``playing``: whether ticks follow each other.
    ``restart``: whether the user wants to begin again.
    """

    def __init__(self, speed: float = 1.0) -> None:
        self.playing, self.restart = True, False
        self._steps = 0
        self._due: float | None = None
        self.set_speed(speed)

    def set_speed(self, speed: float) -> None:
        """Change the speed. Raises InvalidInputError: negative, or not a number."""
        self.speed = finite_number("viewer, speed", speed, least=0.0)
        self._due = None

    def receive(self, request: Request) -> None:
        """Apply a request to the clock."""
        match request:
            case Play(playing):
                self.playing, self._steps, self._due = playing, 0, None
            case StepRequest():
                self.playing, self._steps = False, self._steps + 1
            case Speed(factor):
                self.set_speed(factor)
            case Restart():
                self.restart = self.playing = True
            case _:
                raise InvalidInputError(f"viewer: not a wish about the clock: {request!r}")

    def remaining(self, dt: float) -> float:
        """Return how long to wait [s] before the tick that follows one of ``dt`` [s]; 0: go on.

        Infinite while paused. A requested step or restart is due at once, and then counts as done.
        """
        if self.restart:
            return 0.0
        if not self.playing:
            if not self._steps:
                return math.inf
            self._steps -= 1
            return 0.0
        if not self.speed:
            return 0.0
        now = time.monotonic()
        if self._due is None or now > self._due + MOST_DELAY:
            self._due = now
        left = self._due + dt / self.speed - now
        if left <= 0.0:
            self._due += dt / self.speed
            return 0.0
        return left
