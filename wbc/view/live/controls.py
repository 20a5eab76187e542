"""Play, pause, step, speed, going back in time through what was received; and push controls."""

from __future__ import annotations

import math
import time
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from viser import GuiApi

from wbc.validate import Array
from wbc.view.live.messages import (
    ControllerInfo,
    Frame,
    Play,
    PushRobot,
    Request,
    Restart,
    Speed,
    StepRequest,
)

MOST_FRAMES = 20_000  # frames: eleven minutes at thirty a second
USER_HOLD_TIME = 0.3  # s after the user's last move of the slider, until it may move by itself
SPEEDS = {"0.1": 0.1, "0.25": 0.25, "0.5": 0.5, "1": 1.0, "2": 2.0, "4": 4.0, "max": 0.0}
BUTTONS: Mapping[str, Request] = {
    "Play": Play(True),
    "Pause": Play(False),
    "Step": StepRequest(),
    "Restart": Restart(),
}
INITIAL_SHARE = 0.25  # of the largest push: what the slider begins with
STEPS = 100  # of the slider
HINT = "Or hold Shift and drag a part of the robot: it is pulled towards the pointer."
_STYLE = "font-size:0.8em;line-height:1.35;padding:0 0.9em 0.4em;color:#555"

Send = Callable[[Request], None]


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


class Controls:
    """Buttons of the loop's clock, and the slider through the recording.

    ``past``: the time that is shown [s]; None: the newest frame.
    """

    def __init__(self, gui: GuiApi, send: Send, clock: bool) -> None:
        self.past: float | None = None
        self._replaying = False
        self._moved_at: float | None = None  # when the user moved the slider, until confirmed
        if clock:
            buttons = gui.add_button_group("Loop", tuple(BUTTONS))
            buttons.on_click(lambda event: send(BUTTONS[event.target.value]))
            speed = gui.add_dropdown(
                "Speed", tuple(SPEEDS), initial_value="1", hint="Times real time."
            )
            speed.on_update(lambda event: send(Speed(SPEEDS[event.target.value])))
        self._slider = gui.add_slider("Time [s]", 0.0, 1.0, 0.01, 0.0, hint="Go back in time.")
        self._slider.on_update(self._scrubbed)
        self._live = gui.add_button("Back to now", visible=False)
        self._live.on_click(lambda _: self._go_live())
        self._replay = gui.add_button("Replay from here", visible=False)
        self._replay.on_click(lambda _: self._begin_replay())

    async def _scrubbed(self, event: Any) -> None:
        # async: answered before the page moves the slider on, which would be taken for the user's.
        if event.client_id is not None:  # not moved by the page itself
            self.past, self._replaying = float(event.target.value), False
            self._moved_at = time.monotonic()

    def _go_live(self) -> None:
        self.past, self._replaying = None, False

    def _begin_replay(self) -> None:
        self._replaying = True

    def replay(self) -> None:
        """Play the recording from its beginning."""
        self.past, self._replaying = 0.0, True

    def show(self, recording: Recording, elapsed: float) -> None:
        """Keep the slider in step; ``elapsed`` [s] since the last call moves a replay."""
        first, last = recording.span
        if self._replaying and self.past is not None:
            self.past += elapsed
            if self.past >= last:
                self._go_live()
        # A little room beyond the end, so that the scale does not change with every frame.
        if last > self._slider.max or first < self._slider.min or last < 0.4 * self._slider.max:
            self._slider.min, self._slider.max = first, max(1.0, round(1.3 * last, 1))
        if self.past is None or self._replaying:
            now = last if self.past is None else self.past
            self._slider.value = round(min(max(now, self._slider.min), self._slider.max), 2)
        elif self._moved_at is not None and time.monotonic() > self._moved_at + USER_HOLD_TIME:
            self._moved_at = None
            # The user's position: an update in flight may have moved the slider.
            self._slider.value = self.past + 0.01  # unchanged values are not sent
            self._slider.value = self.past
        looking_back = self.past is not None
        if self._live.visible != looking_back:
            self._live.visible = self._replay.visible = looking_back


class PushControls:
    """Strength and direction of a horizontal push at the CoM, and its button."""

    def __init__(self, gui: GuiApi, send: Send, largest: float) -> None:
        step = float(f"{largest / STEPS:.1g}")
        count = round(largest / step)
        first = float(f"{step * round(INITIAL_SHARE * count):.6g}")  # 1.82, not 1.8200000000000001
        with gui.add_folder("Push"):
            self._impulse = gui.add_slider("Impulse [N s]", 0.0, step * count, step, first)
            self._angle = gui.add_slider(
                "Direction [deg]", -180.0, 180.0, 5.0, 0.0, hint="0: forwards, 90: to the left."
            )
            button = gui.add_button("Push", hint="At the CoM, for a tenth of a second.")
            gui.add_html(f"<div style='{_STYLE}'>{HINT}</div>")
        button.on_click(lambda _: send(PushRobot(self.impulse)))

    @property
    def impulse(self) -> Array:
        """The push that the button would give (3,) [N s]."""
        angle = np.radians(self._angle.value)
        way = np.array((np.cos(angle), np.sin(angle), 0.0))
        return np.asarray(self._impulse.value * way)
