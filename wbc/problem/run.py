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
from wbc.robot import Snapshot
from wbc.validate import Array

if TYPE_CHECKING:
    from wbc.problem.problem import Problem

# Called with ticks done, ticks at most, and time [s], speed, errors by task, failed ticks.
Progress = Callable[[int, int, Mapping[str, Any]], None]
Observe = Callable[[Tick], None]
PROGRESS_EVERY = 10


def run(
    problem: Problem, progress: Progress | None = None, observe: Observe | None = None
) -> Result:
    """Run a problem from its start; see :meth:`wbc.problem.problem.Problem.run`."""
    parts, dt, stop = problem.parts, problem.spec.controller.dt, problem.spec.stop
    total = max(1, math.ceil(stop.duration / dt - 1e-9))
    controller = parts.controller(problem.spec.controller)
    recorder = Recorder(parts.robot, parts.tasks, parts.contacts)
    watch = RestWatch(stop.speed, max((m.ramp.duration for m in parts.moving), default=0.0))
    q: Array = parts.start
    v: Array = np.zeros(parts.robot.nv)
    at_rest = False
    for k in range(total):
        tick, gave_up = _tick(problem, controller, recorder, k * dt, q, v)
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
    return conclude(problem, recorder, parts.robot.snapshot(q, v), at_rest)


def _tick(
    problem: Problem, controller: Controller, recorder: Recorder, time: float, q: Array, v: Array
) -> tuple[Tick, bool]:
    """Run and record one tick; True if the failure policy is to end the run."""
    began, cpu_began = perf_counter(), thread_time()
    snapshot = problem.parts.robot.snapshot(q, v)
    for moving in problem.parts.moving:
        moving.move_to(time)
    tick, gave_up = _step(controller, snapshot)
    seconds, cpu_seconds = perf_counter() - began, thread_time() - cpu_began
    recorder.add(time, snapshot, tick, seconds, cpu_seconds)
    return tick, gave_up


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
