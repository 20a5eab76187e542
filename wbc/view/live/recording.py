"""The frames that the page has seen, for going back in time."""

from __future__ import annotations

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
        self._times: list[float] = []

    def __len__(self) -> int:
        return len(self._frames)

    def add(self, frame: Frame, cast: Cast | None) -> None:
        """Keep a frame; one from before the last begins a new recording, as a restart does."""
        if self._times and frame.time < self._times[-1]:
            self._frames, self._times = [], []
        if self._times and frame.time == self._times[-1]:
            self._frames[-1] = frame, cast
            return
        self._frames.append((frame, cast))
        self._times.append(frame.time)
        if len(self._frames) > self._most:
            half = self._most // 2
            self._frames = self._frames[:half:2] + self._frames[half:]
            self._times = self._times[:half:2] + self._times[half:]

    def replace(self, frames: Sequence[Frame]) -> None:
        """Take frames of a whole run; who played then is known from those that were seen."""
        known = [self.at(frame.time) for frame in frames]
        self._frames = [
            (frame, None if seen is None else seen[1])
            for frame, seen in zip(frames, known, strict=True)
        ]
        self._times = [frame.time for frame in frames]

    @property
    def latest(self) -> tuple[Frame, Cast | None] | None:
        """The newest frame, or None."""
        return self._frames[-1] if self._frames else None

    @property
    def span(self) -> tuple[float, float]:
        """Times of the first and the last frame [s]."""
        return (self._times[0], self._times[-1]) if self._times else (0.0, 0.0)

    def at(self, time: float) -> tuple[Frame, Cast | None] | None:
        """Return the last frame that is not later than ``time``, or the first; None if empty."""
        if not self._frames:
            return None
        return self._frames[max(bisect_right(self._times, time) - 1, 0)]
