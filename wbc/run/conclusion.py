"""From everything recorded to the result of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wbc.robot import Snapshot
from wbc.run.history import History, Measured, Recorder
from wbc.run.result import (
    Failure,
    InertiaReading,
    PhaseResult,
    Result,
    TaskResult,
    Worst,
)
from wbc.run.standing import Standing
from wbc.run.stopping import Stop, ending
from wbc.spatial import COMPONENTS, DIAGONAL, vech_inverse
from wbc.tasks import InertiaTask, PrincipalInertiaTask, Task
from wbc.tasks.inertia import TRACE
from wbc.validate import Array


def conclude(
    tasks: Sequence[Task],
    stop: Stop,
    recorder: Recorder,
    standing: Standing,
    end: Snapshot,
    at_rest: bool,
    broken_off: str | None = None,
    provenance: Mapping[str, Any] | None = None,
) -> Result:
    """Return the result of a run that ended at ``end``, its targets being as they were then.

    Parameters
    ----------
    standing:
        What was held last.
    broken_off:
        Why a phase could not begin, or None.
    provenance:
        Where the run came from, as plain data; becomes a part of the result.
    """
    final = recorder.measure(end, standing)
    results = {
        task.name: TaskResult(
            error=task.deviation(end, task.residual(end)),
            rows=task.reported_rows,
            units=task.units,
            tolerance=stop.accept.get(task.name),
        )
        for task in tasks
    }
    norms = {name: task.norm for name, task in results.items()}
    ticks, history = len(recorder.states), recorder.history()
    status, reason = ending(stop, at_rest, len(recorder.failures), ticks, norms, broken_off)
    states = [*recorder.states, final]
    return Result(
        robot=end.robot,
        status=status,
        reason=reason,
        q=end.q,
        v=end.v,
        final=final,
        tasks=results,
        inertia={
            task.name: _inertia_reading(
                task, states[0].task_inertia[task.name], final.task_inertia[task.name]
            )
            for task in tasks
            if isinstance(task, InertiaTask | PrincipalInertiaTask)
        },
        margin=_worst_margin(states),
        slip=_worst_slip(states),
        balance=_worst_balance(states, history),
        phases=_phase_results(history),
        failures=tuple(Failure(k, report) for k, report in recorder.failures.items()),
        history=history,
        provenance=provenance or {},
    )


def _inertia_reading(
    task: InertiaTask | PrincipalInertiaTask, start: Array, reached: Array
) -> InertiaReading:
    """Return the reading of a task; ``start`` and ``reached`` (6,) are in the task's axes."""
    if isinstance(task, PrincipalInertiaTask):
        moments = [np.linalg.eigvalsh(vech_inverse(s)) for s in (start, reached)]
        rows = task.reported_rows
        return InertiaReading("principal", rows, moments[0], task.target, moments[1])
    values = (_entries(task.rows, s) for s in (start, task.target, reached))
    return InertiaReading(task.frame, task.rows, *values)


def _entries(rows: tuple[str, ...], s: Array) -> Array:
    if rows == TRACE:
        return np.array([s[DIAGONAL].sum()])
    return s[[COMPONENTS.index(row) for row in rows]]


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


def _worst_balance(states: list[Measured], history: History) -> Worst | None:
    margins = np.array([state.balance for state in states])
    if np.isnan(margins).all():
        return None
    tick = int(np.nanargmin(margins))
    return Worst(float(margins[tick]), str(history.phase[min(tick, len(history) - 1)]), tick)


def _phase_results(history: History) -> dict[str, PhaseResult]:
    """Return what each phase came to; none if the run has no phases."""
    results = {}
    for name in filter(None, dict.fromkeys(history.phase.tolist())):
        part = np.flatnonzero(history.phase == name)
        begins, support = float(history.time[part[0]]), str(history.support[part[0]])
        results[name] = PhaseResult(begins, support, float(history.balance[part].min()))
    return results
