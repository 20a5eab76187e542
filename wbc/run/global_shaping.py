"""A run by global shaping: search for the best posture, move there, and report both."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Any

from numpy.typing import ArrayLike

from wbc.controllers.closed_loop import LoopTick
from wbc.run.conclusion import conclude
from wbc.run.history import HistoryRecorder
from wbc.run.phase_support import PhaseSupport
from wbc.run.result import Result
from wbc.run.shaping_report import Posture, SearchEffort, ShapingReport, relative_error
from wbc.run.simulate import (
    DEFAULT_STOP,
    Callbacks,
    Cancelled,
    Observe,
    Progress,
    Show,
    progress_info,
    ticks_in,
)
from wbc.run.stopping import RunStatus, Stop
from wbc.shaping import GlobalShaping, ShapingMotion, ShapingOutcome, Stopped
from wbc.shaping.motion import MakeController
from wbc.shaping.problem import ShapingProblem, posture_errors
from wbc.tasks import InertiaTask, PrincipalInertiaTask, Task
from wbc.validate import Array

_SEARCH_END: Mapping[Stopped | None, str] = {
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
    """Search for the best posture, then run from rest at ``q`` (nq,) to the best reachable one.

    For ``starts`` to ``seed`` see :meth:`~wbc.shaping.GlobalShaping.solve`, for ``dt``,
    ``attempts``, ``tolerance`` and ``make_controller`` its method ``reach``, for the rest
    :func:`wbc.run.simulate`.

    Parameters
    ----------
    tasks:
        Tasks of the result; by default those of the search.
    progress:
        During the search called with searches done, their total, and a mapping with ``cost`` (the
        least so far, or None); then as in any run, with ``posture`` (the rank of the target).

    Notes
    -----
    The search starts other processes: a script needs the usual ``if __name__ == "__main__"`` guard.
    Ctrl-C ends it, and the motion goes to the best posture found until then; ``cancelled`` is
    called during the motion only.

    Raises
    ------
    NoPostureError
        No search ended at a posture that satisfies every constraint.
    KeyboardInterrupt
        Interrupted before a posture was found, or during the motion.
    UnknownNameError
        The stop criteria accept a task that there is not.
    """
    calls, problem = Callbacks(progress, observe, cancelled, show), shaping.problem
    tasks = tuple(tasks) or problem.tasks
    stop.check_tasks(tasks)

    def report_search(search: int, total: int, cost: float | None) -> None:
        if progress is not None:
            progress(search, total, {"cost": cost})

    report_search(0, starts, None)  # sampling and projecting many starts takes a while
    outcome = shaping.solve(q, starts, seconds, workers, seed, report_search, patience)
    reach_started = perf_counter()
    recording = _MotionRecorder(problem, tasks, ticks_in(stop.duration, dt), dt, calls)
    motion = shaping.reach(
        q,
        outcome,
        tolerance,
        attempts,
        dt,
        make_controller,
        longest=stop.duration,
        rest_speed=stop.speed,
        watch=recording.watch,
    )
    search, reach_seconds = outcome.statistics, perf_counter() - reach_started
    statistics = {**vars(search), "stopped": search.stopped and search.stopped.value}
    effort = SearchEffort(**statistics, starts=starts, reach_seconds=reach_seconds)
    recorder = recording.recorders[_target_index(outcome, motion)]
    result = conclude(
        tasks,
        stop,
        recorder,
        recording.standing,
        problem.robot.snapshot(motion.q[-1], recorder.history().v[-1]),
        motion.at_rest,
        provenance=provenance,
        interrupted=calls.interrupted,
    )
    return _with_search(result, problem.tasks, outcome, motion, effort)


class _MotionRecorder:
    """Records and reports the motions to the best postures, one per attempt.

    Other tasks guide these motions; recorded are the errors of the problem's tasks.
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
        """Record a tick of an attempt; return whether the motion ends."""
        if attempt == len(self.recorders):
            self.recorders.append(HistoryRecorder(self.problem.robot, self.tasks))
        recorder = self.recorders[attempt]
        errors = posture_errors(self.problem.tasks, now.snapshot)
        recorder.add(now, self.standing, errors)
        self.calls.tick(now, None)
        done = len(recorder.states)
        info = partial(progress_info, now, errors, len(recorder.failures), posture=attempt + 1)
        return self.calls.should_end(done * self.dt, done, self.total, False, info)


def _with_search(
    result: Result,
    tasks: Sequence[Task],
    outcome: ShapingOutcome,
    motion: ShapingMotion,
    effort: SearchEffort,
) -> Result:
    """Return the result of a motion and its search; good only if the motion arrived."""
    attempts = {attempt.candidate: attempt.reason for attempt in motion.attempts}
    report = ShapingReport(
        postures=tuple(
            Posture(
                q=candidate.q,
                cost=candidate.cost,
                relative_errors=_relative_errors(tasks, candidate.errors),
                status=candidate.status,
                optimal=candidate.optimal,
                starts=candidate.starts,
                tried=attempts.get(k),
            )
            for k, candidate in enumerate(outcome.candidates)
        ),
        rejected=dict(Counter(rejected.kind for rejected in outcome.rejected)),
        cost_start=float(motion.cost[0]),
        cost_end=float(motion.cost[-1]),
        relative_start=_relative_errors(
            tasks, {name: errors[0] for name, errors in result.history.errors.items()}
        ),
        relative_end=_relative_errors(
            tasks, {name: candidate.error for name, candidate in result.tasks.items()}
        ),
        led_to=_target_index(outcome, motion),
        arrived=motion.arrived,
        effort=effort,
    )
    status = result.status
    final_statuses = (RunStatus.QP_FAILED, RunStatus.NOT_KEPT, RunStatus.INTERRUPTED)
    if not report.arrived and status not in final_statuses:
        status = RunStatus.NOT_REACHED
    reason = f"{result.reason}; {report.describe()}"
    stopped = _SEARCH_END.get(outcome.statistics.stopped)
    if stopped is not None:
        reason += f"; the search was {stopped} after {effort.searched} of {effort.starts} starts"
    return replace(result, status=status, reason=reason, shaping=report)


def _target_index(outcome: ShapingOutcome, motion: ShapingMotion) -> int:
    """Return the index of the candidate that a motion went to."""
    return next(k for k, one in enumerate(outcome.candidates) if one is motion.candidate)


def _relative_errors(tasks: Sequence[Task], errors: Mapping[str, Array]) -> dict[str, float]:
    return {
        task.name: relative_error(task, errors[task.name])
        for task in tasks
        if isinstance(task, InertiaTask | PrincipalInertiaTask)
    }
