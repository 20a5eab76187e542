"""The frames that the page has seen, for going back in time."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence

from wbc.view.live.messages import Cast, Frame

MOST = 20_000  # frames: eleven minutes at thirty a second


class Recording:
    """Frames in the order of their times, each with who played then.

    When there are too many, every other one of the older half is forgotten.
    """

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self._frames: list[tuple[Frame, Cast | None]] = []

    def __len__(self) -> int:
        return len(self._frames)

    def add(self, frame: Frame, cast: Cast | None) -> None:
        """Keep a frame; one from before the last begins a new recording, as a restart does."""
        last = _time(self._frames[-1]) if self._frames else -math.inf
        if frame.time < last:
            self._frames = []
        elif frame.time == last:
            self._frames.pop()
        self._frames.append((frame, cast))
        if len(self._frames) > self._most:
            half = self._most // 2
            self._frames = self._frames[:half:2] + self._frames[half:]

    def replace(self, frames: Sequence[Frame]) -> None:
        """Take frames of a whole run; who played then is known from those that were seen."""
        known = [self.at(frame.time) for frame in frames]
        self._frames = [
            (frame, None if seen is None else seen[1])
            for frame, seen in zip(frames, known, strict=True)
        ]

    @property
    def latest(self) -> tuple[Frame, Cast | None] | None:
        """The newest frame, or None."""
        return self._frames[-1] if self._frames else None

    @property
    def span(self) -> tuple[float, float]:
        """Times of the first and the last frame [s]."""
        return (_time(self._frames[0]), _time(self._frames[-1])) if self._frames else (0.0, 0.0)

    def at(self, time: float) -> tuple[Frame, Cast | None] | None:
        """Return the last frame that is not later than ``time``, or the first; None if empty."""
        if not self._frames:
            return None
        return self._frames[max(bisect_right(self._frames, time, key=_time) - 1, 0)]


def _time(kept: tuple[Frame, Cast | None]) -> float:
    return kept[0].time
