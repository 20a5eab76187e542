"""The result of a run from its record."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from wbc.robot import Snapshot
from wbc.robot.names import COM
from wbc.run.history import History, HistoryRecorder, StateRecord
from wbc.run.phase_support import PhaseSupport
from wbc.run.result import Failure, HeldBack, InertiaReading, PhaseResult, Result, TaskResult, Worst
from wbc.run.stopping import Stop, run_status
from wbc.spatial import COMPONENTS, DIAGONAL, vech_inverse
from wbc.tasks import ForceTask, InertiaTask, PrincipalInertiaTask, Task
from wbc.tasks.inertia import TRACE
from wbc.validate import Array


def conclude(
    tasks: Sequence[Task],
    stop: Stop,
    recorder: HistoryRecorder,
    standing: PhaseSupport,
    end: Snapshot,
    at_rest: bool,
    aborted: str | None = None,
    provenance: Mapping[str, Any] | None = None,
    interrupted: float | None = None,
) -> Result:
    """Return the result of a run that ended at ``end``; targets are those of the end.

    ``standing``: the support at the end.
    ``aborted``: why a phase could not begin, or None.
    ``provenance``: origin of the run, as plain data; a part of the result.
    ``interrupted``: time of the cancellation [s], if that ended the run.
    """
    final = recorder.measure(end, standing)
    results = {
        task.name: TaskResult(
            error=recorder.last_error(task)
            if isinstance(task, ForceTask)
            else task.deviation(end, task.residual(end)),
            rows=task.reported_rows,
            units=task.units,
            tolerance=stop.accept.get(task.name),
        )
        for task in tasks
    }
    norms = {name: task.norm for name, task in results.items()}
    ticks, history = len(recorder.states), recorder.history()
    states = [*recorder.states, final]
    balance = _worst_balance(states, history)
    not_kept = tuple(_not_kept(stop, states, [*recorder.standings, standing], balance))
    status, reason = run_status(
        stop, at_rest, len(recorder.failures), ticks, norms, aborted, not_kept, interrupted
    )
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
        slip=_worst_slip(states, lambda tick, frame: True),
        balance=balance,
        clearance=_worst_clearance(states),
        yielding=frozenset().union(*(one.yielding for one in recorder.standings)),
        held_back=_held_back(history),
        not_kept=not_kept,
        phases=_phase_results(history),
        failures=tuple(Failure(k, report) for k, report in recorder.failures.items()),
        left_out=dict(recorder.left_out),
        history=history,
        provenance=provenance or {},
    )


def _inertia_reading(
    task: InertiaTask | PrincipalInertiaTask, start: Array, reached: Array
) -> InertiaReading:
    """Return the reading of a task; ``start`` and ``reached`` (6,) are in the task's axes."""
    if isinstance(task, PrincipalInertiaTask):
        moments = [np.asarray(np.linalg.eigvalsh(vech_inverse(s)), float) for s in (start, reached)]
        rows = task.reported_rows
        return InertiaReading("principal", COM, rows, moments[0], task.target, moments[1])
    values = (_selected_entries(task.rows, s) for s in (start, task.target, reached))
    return InertiaReading(task.frame, task.about, task.rows, *values)


def _selected_entries(rows: tuple[str, ...], s: Array) -> Array:
    if rows == TRACE:
        return np.array([s[DIAGONAL].sum()])
    return s[[COMPONENTS.index(row) for row in rows]]


def _worst_margin(states: list[StateRecord]) -> Worst:
    tick = min(range(len(states)), key=lambda k: states[k].margin)
    return Worst(states[tick].margin, states[tick].margin_joint, tick)


def _worst_slip(states: Sequence[StateRecord], counted: Callable[[int, str], bool]) -> Worst | None:
    """Return the largest slip of the ticks and frames that ``counted`` selects."""
    slips = (
        Worst(distance, frame, tick)
        for tick, state in enumerate(states)
        for frame, distance in state.slip.items()
        if counted(tick, frame)
    )
    return max(slips, key=lambda slip: slip.value, default=None)


def _worst_balance(states: list[StateRecord], history: History) -> Worst | None:
    margins = np.array([state.balance for state in states])
    if np.isnan(margins).all():
        return None
    tick = int(np.nanargmin(margins))
    return Worst(float(margins[tick]), str(history.phase[min(tick, len(history) - 1)]), tick)


def _worst_clearance(states: Sequence[StateRecord]) -> dict[str, Worst]:
    worst = dict[str, Worst]()
    for tick, state in enumerate(states):
        for name, clearance in state.clearance.items():
            if name not in worst or clearance < worst[name].value:
                unit = state.clearance_unit[name]
                worst[name] = Worst(clearance, state.nearest[name], tick, unit)
    return worst


def _held_back(history: History) -> dict[str, HeldBack]:
    """Return the active rows over the run, the longest active first."""
    rows = dict[str, HeldBack]()
    for name, active in history.active.items():
        times = history.time[active]
        rows[name] = HeldBack(times.size, float(times[0]), float(times[-1]))
    return dict(sorted(rows.items(), key=lambda entry: -entry[1].ticks))


def _not_kept(
    stop: Stop,
    states: Sequence[StateRecord],
    standings: Sequence[PhaseSupport],
    balance: Worst | None,
) -> Iterator[str]:
    """Yield in words every condition that was violated in some tick."""
    if stop.balance is not None and balance is not None and balance.value < stop.balance:
        side = "outside" if balance.value < 0.0 else "inside"
        required = f", less than {1e3 * stop.balance:.3g} mm" if balance.value >= 0.0 else ""
        yield (
            f"the robot falls: its CoM was {1e3 * abs(balance.value):.3g} mm {side} the soles"
            f"{required} (tick {balance.tick})"
        )
    if stop.slip is not None:
        worst = _worst_slip(states, lambda tick, frame: frame not in standings[tick].soft)
        if worst is not None and worst.value > stop.slip:
            yield f"{worst.where} slipped by {1e3 * worst.value:.3g} mm (tick {worst.tick})"
    if stop.margins is not None:
        for name, worst in _violations(states, standings, stop.margins).items():
            yield f"{name} exceeded by {-worst.value:.3g} at {worst.where} (tick {worst.tick})"


def _violations(
    states: Sequence[StateRecord], standings: Sequence[PhaseSupport], tolerance: float
) -> dict[str, Worst]:
    """Return the largest violations of limits and margins after they first held in a phase.

    A violation at the beginning of a phase counts only if it is never recovered.
    """
    margins: dict[tuple[str, str], list[Worst]] = {}
    for tick, (state, standing) in enumerate(zip(states, standings, strict=True)):
        for name, value in state.clearance.items():
            if name in standing.yielding:
                continue
            worst = Worst(value, state.nearest[name], tick)
            margins.setdefault((standing.phase, name), []).append(worst)
        if standing.limited:
            worst = Worst(state.margin, state.margin_joint, tick)
            margins.setdefault((standing.phase, "joint limits"), []).append(worst)
    found = dict[str, Worst]()
    for (_, name), values in margins.items():
        first = next((k for k, entry in enumerate(values) if entry.value >= -tolerance), 0)
        worst = min(values[first:], key=lambda entry: entry.value)
        if worst.value < -tolerance and (name not in found or worst.value < found[name].value):
            found[name] = worst
    return found


def _phase_results(history: History) -> dict[str, PhaseResult]:
    """Return the results of the phases; empty if the run has none."""
    results = {}
    for name in filter(None, dict.fromkeys(history.phase.tolist())):
        ticks = np.flatnonzero(history.phase == name)
        begins, support = float(history.time[ticks[0]]), str(history.support[ticks[0]])
        results[name] = PhaseResult(begins, support, float(history.balance[ticks].min()))
    return results
