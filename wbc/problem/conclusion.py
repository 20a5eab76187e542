"""From everything recorded to the result of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wbc.problem.ending import ending
from wbc.problem.provenance import versions
from wbc.problem.recorder import Measured, Record, Recorder
from wbc.problem.result import Failure, PhaseResult, Result, TaskResult, Worst
from wbc.problem.standing import Standing
from wbc.problem.task_rows import InertiaReading, inertia_reading, reported_rows, units
from wbc.robot import Snapshot
from wbc.tasks import InertiaTask, PrincipalInertiaTask

if TYPE_CHECKING:
    from wbc.problem.problem import Problem


def conclude(
    problem: Problem,
    recorder: Recorder,
    standing: Standing,
    end: Snapshot,
    at_rest: bool,
    broken_off: str | None,
) -> Result:
    """Return the result of a run that ended at ``end``, its targets being as they were then.

    Parameters
    ----------
    standing:
        What was held last.
    broken_off:
        Why a phase could not begin, or None.
    """
    final = recorder.measure(end, standing)
    tasks = _task_results(problem, end)
    norms = {name: task.norm for name, task in tasks.items()}
    ticks = len(recorder.records)
    status, reason = ending(
        problem.spec.whole_stop, at_rest, recorder.failed, ticks, norms, broken_off
    )
    states = [*(record.measured for record in recorder.records), final]
    return Result(
        robot=problem.parts.robot,
        status=status,
        reason=reason,
        q=end.q,
        v=end.v,
        final=final,
        tasks=tasks,
        inertia=_inertia_readings(problem, states[0], final),
        margin=_worst_margin(states),
        slip=_worst_slip(states),
        balance=_worst_balance(states, [record.phase for record in recorder.records]),
        phases=_phase_results(recorder.records),
        failures=tuple(
            Failure(k, record.report)
            for k, record in enumerate(recorder.records)
            if record.report is not None
        ),
        history=recorder.history(),
        provenance={"problem": problem.provenance(), "versions": versions()},
    )


def _task_results(problem: Problem, end: Snapshot) -> dict[str, TaskResult]:
    accept = problem.spec.stop.accept
    return {
        task.name: TaskResult(
            error=task.deviation(end, task.residual(end)),
            rows=reported_rows(task),
            units=units(task, getattr(problem.spec.tasks[task.name], "per_mass", False)),
            tolerance=accept.get(task.name),
        )
        for task in problem.parts.tasks
    }


def _inertia_readings(
    problem: Problem, start: Measured, final: Measured
) -> dict[str, InertiaReading]:
    return {
        task.name: inertia_reading(
            task, start.task_inertia[task.name], final.task_inertia[task.name]
        )
        for task in problem.parts.tasks
        if isinstance(task, InertiaTask | PrincipalInertiaTask)
    }


def _worst_margin(states: list[Measured]) -> Worst:
    tick = min(range(len(states)), key=lambda k: states[k].margin)
    return Worst(states[tick].margin, states[tick].margin_joint, tick)


def _worst_slip(states: list[Measured]) -> Worst | None:
    slips = (
        Worst(distance, frame, tick)
        for tick, state in enumerate(states)
        for frame, distance in state.slip.items()
    )
    return max(slips, key=lambda slip: slip.value, default=None)


def _worst_balance(states: list[Measured], phases: list[str]) -> Worst | None:
    margins = np.array([state.balance for state in states])
    if np.isnan(margins).all():
        return None
    tick = int(np.nanargmin(margins))
    return Worst(float(margins[tick]), phases[min(tick, len(phases) - 1)], tick)


def _phase_results(records: list[Record]) -> dict[str, PhaseResult]:
    """Return what each phase came to; none if the run has no phases."""
    parts: dict[str, list[Record]] = {}
    for record in records:
        if record.phase:
            parts.setdefault(record.phase, []).append(record)
    return {
        name: PhaseResult(
            begins=part[0].time,
            support=part[0].support,
            balance=min(record.measured.balance for record in part),
        )
        for name, part in parts.items()
    }
