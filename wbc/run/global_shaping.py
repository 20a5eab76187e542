"""A run by global shaping: search for the best posture, move there, and say what came of both."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Any

from numpy.typing import ArrayLike

from wbc.controllers.closed_loop import LoopTick
from wbc.run.callbacks import Callbacks, Cancelled, Observe, Progress, Show, progress_info
from wbc.run.conclusion import conclude
from wbc.run.history import HistoryRecorder
from wbc.run.phase_support import PhaseSupport
from wbc.run.result import Result
from wbc.run.shaping_report import Posture, SearchEffort, ShapingReport, relative_error
from wbc.run.simulate import DEFAULT_STOP, ticks_in
from wbc.run.stopping import RunStatus, Stop
from wbc.shaping import GlobalShaping, ShapingMotion, ShapingOutcome, Stopped
from wbc.shaping.motion import MakeController
from wbc.shaping.problem import ShapingProblem, posture_errors
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

    For ``starts`` to ``seed`` see :meth:`~wbc.shaping.GlobalShaping.solve`, for ``dt``,
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
    calls = Callbacks(progress, observe, cancelled, show)

    def searched(done: int, total: int, cost: float | None) -> None:
        if progress is not None:
            progress(done, total, {"cost": cost})

    searched(0, starts, None)  # drawing and closing many starts takes a while
    outcome = shaping.solve(q, starts, seconds, workers, seed, searched, patience)
    began = perf_counter()
    problem = shaping.problem
    way = _WayThere(problem, tuple(tasks) or problem.tasks, ticks_in(stop.duration, dt), dt, calls)
    motion = shaping.reach(
        q,
        outcome,
        tolerance,
        attempts,
        dt,
        make_controller,
        longest=stop.duration,
        rest_speed=stop.speed,
        watch=way.watch,
    )
    done, took = outcome.statistics, perf_counter() - began
    told = {**vars(done), "stopped": done.stopped and done.stopped.value}
    effort = SearchEffort(**told, starts=starts, reach_seconds=took)
    recorder = way.recorders[_led_to(outcome, motion)]
    result = conclude(
        way.tasks,
        stop,
        recorder,
        way.standing,
        problem.robot.snapshot(motion.q[-1], recorder.history().v[-1]),
        motion.at_rest,
        provenance=provenance,
        interrupted=calls.interrupted,
    )
    return _with_search(result, problem.tasks, outcome, motion, effort)


class _WayThere:
    """Records and reports the motion to the best postures, an attempt each.

    Other tasks lead the robot on the way; recorded are the errors of the problem's own.
    """

    def __init__(
        self,
        problem: ShapingProblem,
        tasks: tuple[Task, ...],
        total: int,
        dt: float,
        calls: Callbacks,
    ) -> None:
        self.problem, self.tasks = problem, tasks
        self.total, self.dt, self.calls = total, dt, calls
        self.standing = PhaseSupport.on("", problem.contacts, problem.constraints, problem.limits)
        self.recorders: list[HistoryRecorder] = []

    def watch(self, attempt: int, now: LoopTick) -> bool:
        """Take a tick of an attempt; return whether the motion is to end."""
        if attempt == len(self.recorders):
            self.recorders.append(HistoryRecorder(self.problem.robot, self.tasks))
        recorder = self.recorders[attempt]
        errors = posture_errors(self.problem.tasks, now.snapshot)
        recorder.add(now, self.standing, errors)
        self.calls.tick(now, None)
        done = len(recorder.states)
        info = partial(progress_info, now, errors, len(recorder.failures), posture=attempt + 1)
        return self.calls.end_with(done * self.dt, done, self.total, False, info)


def _with_search(
    result: Result,
    tasks: Sequence[Task],
    outcome: ShapingOutcome,
    motion: ShapingMotion,
    effort: SearchEffort,
) -> Result:
    """Return the result of a motion together with the search that it followed.

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


def _led_to(outcome: ShapingOutcome, motion: ShapingMotion) -> int:
    """Return the index of the candidate that a motion was led to."""
    return next(k for k, one in enumerate(outcome.candidates) if one is motion.candidate)


def _relative(tasks: Sequence[Task], errors: Mapping[str, Array]) -> dict[str, float]:
    return {
        task.name: relative_error(task, errors[task.name])
        for task in tasks
        if isinstance(task, InertiaTask | PrincipalInertiaTask)
    }
