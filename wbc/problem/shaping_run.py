"""A run by global shaping: search for the best posture, move there, and say what came of both."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from wbc.controllers.shaping import MotionTick
from wbc.controllers.shaping.merit import posture_errors
from wbc.problem.conclusion import conclude
from wbc.problem.controller_specs import GlobalSpec
from wbc.problem.recorder import Recorder
from wbc.problem.result import Result
from wbc.problem.run import PROGRESS_EVERY, Observe, Progress
from wbc.problem.shaping_checks import global_shaping
from wbc.problem.shaping_conclusion import led_to, search_effort, with_search
from wbc.problem.standing import Standing
from wbc.tasks import Task
from wbc.validate import Array

if TYPE_CHECKING:
    from wbc.problem.problem import Problem


def run_global(
    problem: Problem,
    spec: GlobalSpec,
    progress: Progress | None = None,
    observe: Observe | None = None,
) -> Result:
    """Run a problem whose method is ``global``; see :meth:`wbc.problem.problem.Problem.run`.

    Raises
    ------
    NoPostureError
        No search ended at a posture that keeps every constraint; there is nowhere to move.
    KeyboardInterrupt
        Interrupted before anything was found, or on the way.
    """
    parts, stop = problem.parts, problem.spec.stop
    shaping = global_shaping(parts, problem.spec, spec)

    def searched(done: int, total: int, cost: float | None) -> None:
        if progress is not None:
            progress(done, total, {"cost": cost})

    searched(0, spec.starts, None)  # drawing and closing many starts takes a while
    outcome = shaping.solve(
        parts.start,
        spec.starts,
        spec.seconds,
        spec.workers,
        spec.seed,
        searched,
        spec.patience,
    )
    start = parts.robot.snapshot(parts.start, np.zeros(parts.robot.nv))
    began = perf_counter()
    watcher = _Watcher(problem, shaping.problem.tasks, spec.dt, progress, observe)
    motion = shaping.reach(
        parts.start,
        outcome,
        spec.tolerance,
        spec.attempts,
        spec.dt,
        lambda tasks: parts.controller(spec, tasks, parts.contacts, start),
        longest=stop.duration,
        rest_speed=stop.speed,
        watch=watcher,
    )
    seconds = perf_counter() - began
    recorder = watcher.recorders[led_to(outcome, motion)]
    end = parts.robot.snapshot(motion.q[-1], recorder.records[-1].v)
    result = conclude(problem, recorder, watcher.standing, end, motion.at_rest, None)
    effort = search_effort(outcome.statistics, spec.starts, seconds)
    return with_search(result, shaping.problem.tasks, outcome, motion, effort)


class _Watcher:
    """Records every attempt, and passes on its ticks."""

    def __init__(
        self,
        problem: Problem,
        tasks: tuple[Task, ...],
        dt: float,
        progress: Progress | None,
        observe: Observe | None,
    ) -> None:
        self.tasks = tasks
        self.recorders: list[Recorder] = []
        self.standing = Standing.on("", problem.parts.contacts)
        self._parts, self._dt = problem.parts, dt
        self._total = max(1, math.ceil(problem.spec.stop.duration / dt - 1e-9))
        self._progress, self._observe = progress, observe

    def __call__(self, now: MotionTick) -> None:
        if now.attempt == len(self.recorders):
            self.recorders.append(Recorder(self._parts.robot, self._parts.tasks))
        recorder = self.recorders[now.attempt]
        # On the way other tasks lead; what is told is how far the problem's own are.
        errors = posture_errors(self.tasks, now.snapshot)
        tick = replace(now.tick, errors=errors)
        recorder.add(now.time, now.snapshot, self.standing, tick, now.seconds, now.cpu_seconds)
        if self._observe is not None:
            self._observe(now.tick)
        done = len(recorder.records)
        if self._progress is not None and (done - 1) % PROGRESS_EVERY == 0:
            self._progress(done, self._total, _info(now, errors, recorder.failed))


def _info(now: MotionTick, errors: Mapping[str, Array], failed: int) -> dict[str, Any]:
    return {
        "time": now.time,
        "speed": float(np.abs(now.tick.velocity).max()),
        "errors": {name: float(np.linalg.norm(error)) for name, error in errors.items()},
        "failed": failed,
        "posture": now.attempt + 1,
    }
