"""From everything recorded to the result of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wbc.problem.ending import ending
from wbc.problem.recorder import Measured, Recorder
from wbc.problem.result import Failure, Result, TaskResult, Worst
from wbc.problem.task_rows import InertiaReading, inertia_reading, reported_rows, units
from wbc.problem.versions import versions
from wbc.robot import Snapshot
from wbc.tasks import InertiaTask, PrincipalInertiaTask

if TYPE_CHECKING:
    from wbc.problem.problem import Problem


def conclude(problem: Problem, recorder: Recorder, end: Snapshot, at_rest: bool) -> Result:
    """Return the result of a run that ended at ``end``."""
    final = recorder.measure(end)
    tasks = _task_results(problem, end, len(recorder.records))
    norms = {name: task.norm for name, task in tasks.items()}
    status, reason = ending(
        problem.spec.stop, at_rest, recorder.failed, len(recorder.records), norms
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
        failures=tuple(
            Failure(k, record.report)
            for k, record in enumerate(recorder.records)
            if record.report is not None
        ),
        history=recorder.history(),
        provenance={"problem": problem.provenance(), "versions": versions()},
    )


def _task_results(problem: Problem, end: Snapshot, ticks: int) -> dict[str, TaskResult]:
    for moving in problem.parts.moving:
        moving.move_to(ticks * problem.spec.controller.dt)
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
