"""What happened in a run, tick by tick, and the recorder that keeps it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.constraints import Limits
from wbc.controllers import Tick
from wbc.controllers.closed_loop import LoopTick
from wbc.robot import Robot, Snapshot
from wbc.run.standing import Standing
from wbc.spatial import vech
from wbc.tasks import InertiaTask, PrincipalInertiaTask, Task
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class History:
    """One row per tick: the state in which it began, and what the controller answered.

    Attributes
    ----------
    time:
        (n,) when the tick began [s].
    phase:
        (n,) name of the phase; empty in a run without phases.
    support:
        (n,) what is held, with commas between: feet by name, such as ``left,right``, or frames.
    q:
        (n, nq) configuration then.
    v:
        (n, nv) velocity commanded, and applied until the next tick.
    com:
        (n, 3) centre of mass [m].
    inertia:
        (n, 6) centroidal inertia xx xy xz yy yz zz [kg m^2], world axes.
    task_inertia:
        (n, 6) the same in the axes of each inertia task, by task.
    errors:
        (n, k) error of each task, actual minus target, by task; NaN while the task is off.
    slip, turn:
        (n,) how far each contact is from its anchor [m], [rad], by frame; NaN while it is not held.
        The anchor is where the frame was when it was last put down.
    margin:
        (n,) smallest distance to a joint position limit [rad or m].
    balance:
        (n,) how far the CoM's projection is inside the polygon of the soles that stand [m],
        negative outside; NaN if no feet stand, or something else is held too.
    kkt:
        (n,) largest KKT residual; NaN where the QP was not solved.
    tick_time, tick_cpu_time:
        (n,) seconds from measurement to command, by the clock and of this thread's CPU.
    status:
        (n,) status of each QP.
    """

    time: Array
    phase: NDArray[np.str_]
    support: NDArray[np.str_]
    q: Array
    v: Array
    com: Array
    inertia: Array
    task_inertia: Mapping[str, Array]
    errors: Mapping[str, Array]
    slip: Mapping[str, Array]
    turn: Mapping[str, Array]
    margin: Array
    balance: Array
    kkt: Array
    tick_time: Array
    tick_cpu_time: Array
    status: NDArray[np.str_]

    def __len__(self) -> int:
        return int(self.time.size)

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return every array under a flat name; those by task or frame as ``errors/com``."""
        flat: dict[str, NDArray[np.generic]] = {}
        for part in fields(self):
            value = getattr(self, part.name)
            if isinstance(value, Mapping):
                flat |= {f"{part.name}/{name}": array for name, array in value.items()}
            else:
                flat[part.name] = value
        return flat


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
        self._frames = {
            task.name: task.frame if isinstance(task, InertiaTask) else "base"
            for task in tasks
            if isinstance(task, InertiaTask | PrincipalInertiaTask)
        }

    def add(
        self, now: LoopTick, standing: Standing, errors: Mapping[str, Array] | None = None
    ) -> None:
        """Keep what matters of a tick.

        Parameters
        ----------
        errors:
            Of the tasks, by name; by default those that the tick reports.
        """
        tick = now.tick
        self.failed += not tick.ok
        self.records.append(
            Record(
                time=now.time,
                phase=standing.phase,
                support=standing.label,
                q=now.snapshot.q,
                v=tick.velocity,
                measured=self.measure(now.snapshot, standing),
                errors=tick.errors if errors is None else errors,
                status=tick.status.value,
                kkt=_kkt_residual(tick),
                report=None if tick.ok else tick.report(),
                seconds=now.seconds,
                cpu_seconds=now.cpu_seconds,
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
