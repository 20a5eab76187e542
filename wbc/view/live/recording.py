"""The frames that the page has received, for going back in time."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence

from wbc.view.live.messages import ControllerInfo, Frame

MOST_FRAMES = 20_000  # frames: eleven minutes at thirty a second


class Recording:
    """Frames in order of time, each with its controller's description.

    When there are too many, every other one of the older half is dropped.
    """

    def __init__(self, most: int = MOST_FRAMES) -> None:
        self._most = most
        self._frames: list[tuple[Frame, ControllerInfo | None]] = []

    def __len__(self) -> int:
        return len(self._frames)

    def add(self, frame: Frame, cast: ControllerInfo | None) -> None:
        """Add a frame; one earlier than the last starts a new recording, as after a restart."""
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
        """Set the frames of a whole run, with the controllers' descriptions received before."""
        known = [self.at(frame.time) for frame in frames]
        self._frames = [
            (frame, None if seen is None else seen[1])
            for frame, seen in zip(frames, known, strict=True)
        ]

    @property
    def latest(self) -> tuple[Frame, ControllerInfo | None] | None:
        """The newest frame, or None."""
        return self._frames[-1] if self._frames else None

    @property
    def span(self) -> tuple[float, float]:
        """Times of the first and the last frame [s]."""
        return (_time(self._frames[0]), _time(self._frames[-1])) if self._frames else (0.0, 0.0)

    def at(self, time: float) -> tuple[Frame, ControllerInfo | None] | None:
        """Return the last frame that is not later than ``time``, or the first; None if empty."""
        if not self._frames:
            return None
        return self._frames[max(bisect_right(self._frames, time, key=_time) - 1, 0)]


def _time(kept: tuple[Frame, ControllerInfo | None]) -> float:
    return kept[0].time
