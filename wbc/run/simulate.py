"""Runs a controller, or phases, in a closed loop from a start; callbacks of runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wbc.controllers import Controller, Tick
from wbc.controllers.closed_loop import LoopTick, closed_loop, ticks_of
from wbc.run.conclusion import conclude
from wbc.run.history import HistoryRecorder
from wbc.run.phases import PhaseExecutor
from wbc.run.result import Result
from wbc.run.stopping import RestDetector, Stop
from wbc.validate import Array

# Called with ticks done, the largest number of ticks, and time [s], speed, errors by task, failed
# ticks; by a search with searches done, their total, and cost.
Progress = Callable[[int, int, Mapping[str, Any]], None]
Observe = Callable[[Tick], None]
Cancelled = Callable[[], bool]  # asked after every tick whether the run is to end there
# Called with every tick of the loop and its controller, if that is the problem's own.
Show = Callable[[LoopTick, Controller | None], None]
PROGRESS_EVERY = 10  # ticks
DEFAULT_STOP = Stop()


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


def simulate(
    controller: Controller | PhaseExecutor,
    q: ArrayLike,
    stop: Stop = DEFAULT_STOP,
    progress: Progress | None = None,
    observe: Observe | None = None,
    provenance: Mapping[str, Any] | None = None,
    cancelled: Cancelled | None = None,
    show: Show | None = None,
) -> Result:
    """Run from rest at ``q`` (nq,) until the robot is at rest, out of time, or has failed.

    The robot moves exactly as commanded: each tick's velocity is integrated over one time step.

    Parameters
    ----------
    controller:
        One controller, or phases, which have a state and serve one run.
    progress:
        Called every ten ticks and at the end with ticks done, ticks at most, and a mapping with
        ``time`` [s], ``speed`` (largest velocity), ``errors`` (norm by task) and ``failed`` (ticks
        without solution).
    observe:
        Called with every tick: its QP, solution and errors.
    provenance:
        Origin of the run, as plain data; a part of the result.
    cancelled:
        Called after every tick; True ends the run there, with the result so far.
    show:
        Called with every tick of the loop, with its state and controller: for live views.

    Raises
    ------
    InvalidInputError
        An unusable configuration.
    UnknownNameError
        The stop criteria accept a task that there is not.
    """
    if not isinstance(controller, PhaseExecutor):
        controller = PhaseExecutor.single(controller, controller.robot.snapshot(q))
    phases, calls = controller, Callbacks(progress, observe, cancelled, show)
    stop.check_tasks(phases.tasks)
    first = phases.controller
    robot, dt = first.robot, first.dt
    total = ticks_in(stop.duration, dt)
    recorder = HistoryRecorder(robot, phases.tasks)
    rest = RestDetector(stop.speed, phases.ramps_end)
    at_rest = False
    for now in closed_loop(first, q, total, phases.update):
        recorder.add(now, phases.standing)
        calls.tick(now, phases.controller)
        at_rest = rest.at_rest(now.time, now.speed, now.tick.ok)
        done = len(recorder.states)
        over = at_rest or now.gave_up or done == total
        info = partial(progress_info, now, now.tick.errors, len(recorder.failures))
        if calls.should_end(done * dt, done, total, over, info):
            break
    phases.move_to(done * dt)
    end = robot.snapshot(now.q, now.tick.velocity)
    return conclude(
        phases.tasks,
        stop,
        recorder,
        phases.standing,
        end,
        at_rest,
        phases.complaint,
        provenance,
        calls.interrupted,
    )


def ticks_in(duration: float, dt: float) -> int:
    """Return how many ticks of ``dt`` [s] a run of ``duration`` [s] has, at least one."""
    return max(1, ticks_of(duration, dt))
