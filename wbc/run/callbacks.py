"""Callbacks of a run: progress, every tick, cancellation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from wbc.controllers import Controller, Tick
from wbc.controllers.closed_loop import LoopTick
from wbc.validate import Array

# Called with ticks done, the largest number of ticks, and time [s], speed, errors by task, failed
# ticks; by a search with searches done, their total, and cost.
Progress = Callable[[int, int, Mapping[str, Any]], None]
Observe = Callable[[Tick], None]
Cancelled = Callable[[], bool]  # asked after every tick whether the run is to end there
# Called with every tick of the loop and its controller, if that is the problem's own.
Show = Callable[[LoopTick, Controller | None], None]
PROGRESS_EVERY = 10  # ticks


@dataclass
class Callbacks:
    """Callbacks of one run, see :func:`wbc.run.simulate`; None: not called."""

    progress: Progress | None = None
    observe: Observe | None = None
    cancelled: Cancelled | None = None
    show: Show | None = None
    interrupted: float | None = None  # time of the cancellation [s]; None without one

    def tick(self, now: LoopTick, controller: Controller | None) -> None:
        """Pass on a tick of the loop, and its controller."""
        if self.observe is not None:
            self.observe(now.tick)
        if self.show is not None:
            self.show(now, controller)

    def should_end(
        self, time: float, done: int, total: int, over: bool, info: Callable[[], Mapping[str, Any]]
    ) -> bool:
        """Return whether the run ends with this tick: it is over, or cancelled.

        Progress is reported every tenth tick and at the last, with the result of ``info``.
        """
        if not over and self.cancelled is not None and self.cancelled():
            self.interrupted, over = time, True
        if self.progress is not None and ((done - 1) % PROGRESS_EVERY == 0 or over):
            self.progress(done, total, info())
        return over


def progress_info(
    now: LoopTick, errors: Mapping[str, Array], failed: int, **more: Any
) -> dict[str, Any]:
    """Return the progress at a tick: time [s], largest speed, error norms, failed ticks."""
    norms = {name: float(np.linalg.norm(error)) for name, error in errors.items()}
    return {"time": now.time, "speed": now.speed, "errors": norms, "failed": failed, **more}
