"""The closed kinematic loop: snapshot, controller, integration, until the run ends."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from time import perf_counter, thread_time
from typing import TYPE_CHECKING, Any

import numpy as np

from wbc.controllers import Tick
from wbc.errors import ControllerFailure
from wbc.problem.build import Controller
from wbc.problem.conclusion import conclude
from wbc.problem.ending import RestWatch
from wbc.problem.recorder import Recorder
from wbc.problem.result import Result
from wbc.problem.stage import Stage
from wbc.robot import Snapshot
from wbc.validate import Array

if TYPE_CHECKING:
    from wbc.problem.problem import Problem

# Called with ticks done, ticks at most, and time [s], speed, errors by task, failed ticks; by a
# search with searches done, searches in all, and cost.
Progress = Callable[[int, int, Mapping[str, Any]], None]
Observe = Callable[[Tick], None]
PROGRESS_EVERY = 10


def run(
    problem: Problem, progress: Progress | None = None, observe: Observe | None = None
) -> Result:
    """Run a problem from its start; see :meth:`wbc.problem.problem.Problem.run`."""
    parts, dt, stop = problem.parts, problem.spec.controller.dt, problem.spec.whole_stop
    total = max(1, math.ceil(stop.duration / dt - 1e-9))
    stage = Stage(problem, parts.robot.snapshot(parts.start, np.zeros(parts.robot.nv)))
    recorder = Recorder(parts.robot, parts.tasks)
    watch = RestWatch(stop.speed, max((one.ramp or 0.0 for one in parts.built), default=0.0))
    q: Array = parts.start
    v: Array = np.zeros(parts.robot.nv)
    at_rest, broken_off = False, None
    for k in range(total):
        began, cpu_began = perf_counter(), thread_time()
        snapshot = parts.robot.snapshot(q, v)
        broken_off = stage.ready(k, snapshot)
        if broken_off is not None:
            break
        tick, gave_up = _step(stage.controller, snapshot)
        seconds, cpu_seconds = perf_counter() - began, thread_time() - cpu_began
        recorder.add(k * dt, snapshot, stage.standing, tick, seconds, cpu_seconds)
        if observe is not None:
            observe(tick)
        v = tick.velocity
        q = parts.robot.integrate(q, v, dt)
        fastest = float(np.abs(v).max())
        at_rest = watch.at_rest(k * dt, fastest, tick.ok)
        over = at_rest or gave_up or k == total - 1
        if progress is not None and (k % PROGRESS_EVERY == 0 or over):
            progress(k + 1, total, _info(k * dt, fastest, tick, recorder.failed))
        if over:
            break
    stage.move_to(len(recorder.records) * dt)
    end = parts.robot.snapshot(q, v)
    return conclude(problem, recorder, stage.standing, end, at_rest, broken_off)


def _step(controller: Controller, snapshot: Snapshot) -> tuple[Tick, bool]:
    try:
        return controller.step(snapshot), False
    except ControllerFailure as failure:
        if not isinstance(failure.tick, Tick):
            raise
        return failure.tick, True


def _info(time: float, fastest: float, tick: Tick, failed: int) -> dict[str, Any]:
    errors = {name: float(np.linalg.norm(error)) for name, error in tick.errors.items()}
    return {"time": time, "speed": fastest, "errors": errors, "failed": failed}
