"""From a search and the motion that followed it to what the result says about them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from wbc.controllers.shaping import Motion, ShapingOutcome, ShapingStatistics, Stopped
from wbc.problem.ending import RunStatus
from wbc.problem.provenance import version_of
from wbc.problem.result import Result
from wbc.problem.shaping_report import Posture, SearchEffort, ShapingReport, relative_error
from wbc.tasks import InertiaTask, PrincipalInertiaTask, Task
from wbc.validate import Array

_ENDED_BY: Mapping[Stopped | None, str] = {
    Stopped.SECONDS: "out of time",
    Stopped.INTERRUPTED: "interrupted",
}


def search_effort(done: ShapingStatistics, starts: int, reach_seconds: float) -> SearchEffort:
    """Return what a search took that was to begin from ``starts``, and the motion after it."""
    return SearchEffort(
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


def with_search(
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
        led_to=led_to(outcome, motion),
        arrived=motion.arrived,
        effort=effort,
    )
    status = result.status
    if not report.arrived and status is not RunStatus.QP_FAILED:
        status = RunStatus.NOT_REACHED
    reason = f"{result.reason}; {report.describe()}"
    stopped = _ENDED_BY.get(outcome.statistics.stopped)
    if stopped is not None:
        reason += f"; the search was {stopped} after {effort.searched} of {effort.starts} starts"
    provenance = dict(result.provenance)
    provenance["versions"] = {**provenance["versions"], "casadi": version_of("casadi")}
    return replace(result, status=status, reason=reason, shaping=report, provenance=provenance)


def led_to(outcome: ShapingOutcome, motion: Motion) -> int:
    """Return the index of the candidate that a motion was led to."""
    return next(k for k, one in enumerate(outcome.candidates) if one is motion.candidate)


def _relative(tasks: Sequence[Task], errors: Mapping[str, Array]) -> dict[str, float]:
    return {
        task.name: relative_error(task, errors[task.name])
        for task in tasks
        if isinstance(task, InertiaTask | PrincipalInertiaTask)
    }
