"""Keeps what a run did, tick by tick, and makes the history of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from wbc.constraints import Limits
from wbc.controllers import Tick
from wbc.problem.history import History
from wbc.problem.standing import Standing
from wbc.robot import Robot, Snapshot
from wbc.spatial import vech
from wbc.tasks import Task
from wbc.tasks.inertia import InertiaTask
from wbc.tasks.principal_inertia import PrincipalInertiaTask
from wbc.validate import Array


class Measured(NamedTuple):
    """What is read off a state, beside what the controller says of it."""

    com: Array  # (3,)
    inertia: Array  # (6,)
    task_inertia: dict[str, Array]  # (6,)
    slip: dict[str, float]
    turn: dict[str, float]
    margin: float
    margin_joint: str
    balance: float  # NaN unless feet stand


class Record(NamedTuple):
    """What is kept of one tick: not the snapshot and the QP, which are a hundred times larger."""

    time: float
    phase: str
    support: str
    q: Array
    v: Array
    measured: Measured
    errors: Mapping[str, Array]
    status: str
    kkt: float
    report: str | None  # why there was no solution
    seconds: float
    cpu_seconds: float


class Recorder:
    """Measures states and collects ticks.

    Attributes
    ----------
    records:
        Every tick so far.
    failed:
        How many of them had no solution.
    """

    def __init__(self, robot: Robot, tasks: Iterable[Task]) -> None:
        self.records: list[Record] = []
        self.failed = 0
        self._limits = Limits(robot)  # only to read the margin: also in a run without limits
        self._frames = {task.name: axes_of(task) for task in tasks if is_inertia(task)}

    def add(
        self,
        time: float,
        snapshot: Snapshot,
        standing: Standing,
        tick: Tick,
        seconds: float,
        cpu_seconds: float,
    ) -> None:
        """Keep what matters of a tick that began at ``time`` [s] in the state ``snapshot``."""
        self.failed += not tick.ok
        self.records.append(
            Record(
                time=time,
                phase=standing.phase,
                support=standing.label,
                q=snapshot.q,
                v=tick.velocity,
                measured=self.measure(snapshot, standing),
                errors=tick.errors,
                status=tick.status.value,
                kkt=_kkt_residual(tick),
                report=None if tick.ok else tick.report(),
                seconds=seconds,
                cpu_seconds=cpu_seconds,
            )
        )

    def measure(self, snapshot: Snapshot, standing: Standing) -> Measured:
        """Return what the summary needs to know of a state."""
        drifts = {contact.frame: contact.residual(snapshot).error for contact in standing.contacts}
        margin, joint = self._limits.worst_margin(snapshot.q)
        return Measured(
            com=snapshot.com,
            inertia=vech(snapshot.inertia),
            task_inertia={
                name: vech(snapshot.inertia_in(frame)) for name, frame in self._frames.items()
            },
            slip={frame: float(np.linalg.norm(drift[:3])) for frame, drift in drifts.items()},
            turn={frame: float(np.linalg.norm(drift[3:])) for frame, drift in drifts.items()},
            margin=margin,
            margin_joint=joint,
            balance=standing.margin(snapshot),
        )

    def history(self) -> History:
        """Return everything recorded, as arrays."""
        records = self.records
        measured = [record.measured for record in records]
        return History(
            time=np.array([record.time for record in records]),
            phase=np.array([record.phase for record in records]),
            support=np.array([record.support for record in records]),
            q=np.array([record.q for record in records]),
            v=np.array([record.v for record in records]),
            com=np.array([state.com for state in measured]),
            inertia=np.array([state.inertia for state in measured]),
            task_inertia=_by_name([state.task_inertia for state in measured]),
            errors=_by_name([record.errors for record in records]),
            slip=_by_name([state.slip for state in measured]),
            turn=_by_name([state.turn for state in measured]),
            margin=np.array([state.margin for state in measured]),
            balance=np.array([state.balance for state in measured]),
            kkt=np.array([record.kkt for record in records]),
            tick_time=np.array([record.seconds for record in records]),
            tick_cpu_time=np.array([record.cpu_seconds for record in records]),
            status=np.array([record.status for record in records]),
        )


def is_inertia(task: Task) -> bool:
    """Whether a task controls the robot's inertia."""
    return isinstance(task, InertiaTask | PrincipalInertiaTask)


def axes_of(task: Task) -> str:
    """Return the frame in whose axes an inertia task is measured."""
    return task.frame if isinstance(task, InertiaTask) else "base"


def _kkt_residual(tick: Tick) -> float:
    residuals = tick.solution.residuals
    return max(residuals.primal, residuals.dual, residuals.complementarity) if tick.ok else np.nan


def _by_name(rows: Sequence[Mapping[str, Array | float]]) -> dict[str, Array]:
    """Return one array per name, NaN in the rows that do not have it."""
    shapes = {name: np.shape(value) for row in rows for name, value in row.items()}
    return {
        name: np.array([row.get(name, np.full(shape, np.nan)) for row in rows])
        for name, shape in shapes.items()
    }
