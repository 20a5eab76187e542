"""A run by global shaping: search for the best posture, move there, and say what came of both."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Any

from numpy.typing import ArrayLike

from wbc.controllers.closed_loop import LoopTick
from wbc.controllers.shaping import GlobalShaping, Motion, ShapingOutcome, Stopped
from wbc.controllers.shaping.motion import MakeController
from wbc.controllers.shaping.problem import posture_errors
from wbc.run.conclusion import conclude
from wbc.run.history import Recorder
from wbc.run.result import Result
from wbc.run.shaping_report import Posture, SearchEffort, ShapingReport, relative_error
from wbc.run.simulate import (
    DEFAULT_STOP,
    PROGRESS_EVERY,
    Cancelled,
    Observe,
    Progress,
    Show,
    progress_info,
    ticks_in,
)
from wbc.run.standing import Standing
from wbc.run.stopping import RunStatus, Stop
from wbc.tasks import InertiaTask, PrincipalInertiaTask, Task
from wbc.validate import Array

_ENDED_BY: Mapping[Stopped | None, str] = {
    Stopped.SECONDS: "out of time",
    Stopped.INTERRUPTED: "interrupted",
}


def shape_globally(
    shaping: GlobalShaping,
    q: ArrayLike,
    stop: Stop = DEFAULT_STOP,
    *,
    dt: float = 0.005,
    starts: int = 64,
    patience: int | None = None,
    seconds: float | None = None,
    workers: int = 2,
    seed: int = 0,
    attempts: int = 5,
    tolerance: float = 0.01,
    make_controller: MakeController | None = None,
    tasks: Sequence[Task] = (),
    progress: Progress | None = None,
    observe: Observe | None = None,
    provenance: Mapping[str, Any] | None = None,
    cancelled: Cancelled | None = None,
    show: Show | None = None,
) -> Result:
    """Search for the best posture, then run from rest at ``q`` (nq,) to one that can be reached.

    For ``starts`` to ``seed`` see :meth:`~wbc.controllers.shaping.GlobalShaping.solve`, for ``dt``,
    ``attempts``, ``tolerance`` and ``make_controller`` its method ``reach``, for the rest
    :func:`wbc.run.simulate`.

    Parameters
    ----------
    tasks:
        What the result reports on; by default the tasks of the search.
    progress:
        While it searches: called with searches done, searches in all, and a mapping with ``cost``
        (the least so far, or None); then as in any run, with ``posture`` (the rank of the one it is
        led to).

    Notes
    -----
    The search starts other processes: a script needs the usual ``if __name__ == "__main__"`` guard.
    Ctrl-C ends it, and the motion goes to the best posture found until then; ``cancelled`` is asked
    on the way there only.

    Raises
    ------
    NoPostureError
        No search ended at a posture that keeps every constraint; there is nowhere to move.
    KeyboardInterrupt
        Interrupted before anything was found, or on the way.
    """

    def searched(done: int, total: int, cost: float | None) -> None:
        if progress is not None:
            progress(done, total, {"cost": cost})

    searched(0, starts, None)  # drawing and closing many starts takes a while
    outcome = shaping.solve(q, starts, seconds, workers, seed, searched, patience)
    began = perf_counter()
    problem = shaping.problem
    tasks = tuple(tasks) or problem.tasks
    standing = Standing.on("", problem.contacts, problem.constraints, problem.limits)
    recorders: list[Recorder] = []
    total = ticks_in(stop.duration, dt)
    interrupted: float | None = None

    def watch(attempt: int, now: LoopTick) -> bool:
        nonlocal interrupted
        if attempt == len(recorders):
            recorders.append(Recorder(problem.robot, tasks))
        recorder = recorders[attempt]
        # On the way other tasks lead; what is told is how far the problem's own are.
        errors = posture_errors(problem.tasks, now.snapshot)
        recorder.add(now, standing, errors)
        if observe is not None:
            observe(now.tick)
        if show is not None:
            show(now, None)
        done = len(recorder.states)
        if progress is not None and (done - 1) % PROGRESS_EVERY == 0:
            info = progress_info(now, errors, len(recorder.failures))
            progress(done, total, {**info, "posture": attempt + 1})
        if cancelled is not None and cancelled():
            interrupted = done * dt
        return interrupted is not None

    motion = shaping.reach(
        q,
        outcome,
        tolerance,
        attempts,
        dt,
        make_controller,
        longest=stop.duration,
        rest_speed=stop.speed,
        watch=watch,
    )
    reach_seconds = perf_counter() - began
    recorder = recorders[_led_to(outcome, motion)]
    end = problem.robot.snapshot(motion.q[-1], recorder.history().v[-1])
    at_rest = motion.at_rest
    result = conclude(
        tasks,
        stop,
        recorder,
        standing,
        end,
        at_rest,
        provenance=provenance,
        interrupted=interrupted,
    )
    done = outcome.statistics
    effort = SearchEffort(
        starts=starts,
        drawn=done.drawn,
        searched=done.searched,
        iterations=done.iterations,
        build_seconds=done.build_seconds,
        search_seconds=done.search_seconds,
        reach_seconds=reach_seconds,
        workers=done.workers,
        stopped=None if done.stopped is None else done.stopped.value,
    )
    return _with_search(result, problem.tasks, outcome, motion, effort)


def _with_search(
    result: Result,
    tasks: Sequence[Task],
    outcome: ShapingOutcome,
    motion: Motion,
    effort: SearchEffort,
) -> Result:
    """Return the result of a motion with what is known of the search that it followed.

    It counts as good only if the motion arrived.
    """
    tried = {attempt.candidate: attempt.reason for attempt in motion.attempts}
    report = ShapingReport(
        postures=tuple(
            Posture(
                q=one.q,
                cost=one.cost,
                relative_errors=_relative(tasks, one.errors),
                status=one.status,
                optimal=one.optimal,
                starts=one.starts,
                tried=tried.get(k),
            )
            for k, one in enumerate(outcome.candidates)
        ),
        rejected=dict(Counter(rejected.kind for rejected in outcome.rejected)),
        cost_start=float(motion.cost[0]),
        cost_end=float(motion.cost[-1]),
        relative_start=_relative(
            tasks, {name: errors[0] for name, errors in result.history.errors.items()}
        ),
        relative_end=_relative(tasks, {name: one.error for name, one in result.tasks.items()}),
        led_to=_led_to(outcome, motion),
        arrived=motion.arrived,
        effort=effort,
    )
    status = result.status
    ended = (RunStatus.QP_FAILED, RunStatus.NOT_KEPT, RunStatus.INTERRUPTED)
    if not report.arrived and status not in ended:
        status = RunStatus.NOT_REACHED
    reason = f"{result.reason}; {report.describe()}"
    stopped = _ENDED_BY.get(outcome.statistics.stopped)
    if stopped is not None:
        reason += f"; the search was {stopped} after {effort.searched} of {effort.starts} starts"
    return replace(result, status=status, reason=reason, shaping=report)


def _led_to(outcome: ShapingOutcome, motion: Motion) -> int:
    """Return the index of the candidate that a motion was led to."""
    return next(k for k, one in enumerate(outcome.candidates) if one is motion.candidate)


def _relative(tasks: Sequence[Task], errors: Mapping[str, Array]) -> dict[str, float]:
    return {
        task.name: relative_error(task, errors[task.name])
        for task in tasks
        if isinstance(task, InertiaTask | PrincipalInertiaTask)
    }
