"""A run in the browser without interaction: shown live, and afterwards replayed."""

from __future__ import annotations

import numpy as np

from wbc.controllers import Controller
from wbc.controllers.closed_loop import LoopTick
from wbc.robot import Robot
from wbc.run.history import History
from wbc.simulation.terrain import LEVEL, Terrain
from wbc.view.live.messages import Frame, TickInfo
from wbc.view.live.viewer import Viewer

RATE = 60.0  # frames for each second of the run


class RunViewer:
    """Shows a run without interaction, so that its result is that of an unwatched one."""

    def __init__(self, robot: Robot, *, title: str | None = None, terrain: Terrain = LEVEL) -> None:
        self.viewer = Viewer(robot, title=title, steer=False, terrain=terrain)

    def show(self, now: LoopTick, controller: Controller | None) -> None:
        """Show a tick: for ``show`` of :func:`wbc.run.simulate`."""
        self.viewer.controller = controller
        self.viewer.update(now.snapshot, now.tick, now.time, seconds=now.seconds)

    def replay(self, history: History) -> None:
        """Send the whole run, of which only a part was sent while it ran."""
        self.viewer.replay(frames_of(history))


def frames_of(history: History, rate: float = RATE) -> list[Frame]:
    """Return the frames of a recorded run, at most so many for each of its seconds."""
    time = history.time
    step = 1 if len(time) < 2 else max(1, round(1.0 / rate / float(time[1] - time[0])))
    return [_frame(history, k) for k in range(0, len(time), step)]


def _frame(history: History, k: int) -> Frame:
    errors = {name: each[k] for name, each in history.errors.items()}
    told = TickInfo(
        ok=history.status[k] == "solved",
        report=str(history.status[k]),
        seconds=float(history.tick_time[k]),
        errors={name: error for name, error in errors.items() if not np.isnan(error).any()},
    )
    v = history.v[k - 1] if k else np.zeros_like(history.v[0])  # measured, not yet commanded
    return Frame(float(history.time[k]), history.q[k], v, told, phase=str(history.phase[k]))
