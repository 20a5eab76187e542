"""The history of a run, tick by tick, and its recorder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.constraints import Limits
from wbc.controllers import Tick
from wbc.controllers.closed_loop import LoopTick
from wbc.controllers.tick import ACTIVE, NEGLIGIBLE
from wbc.robot import Robot, Snapshot
from wbc.robot.collision import Shape
from wbc.robot.names import BASE, COM
from wbc.run.obstacles import ObstacleTrack, obstacles_of, place_of
from wbc.run.phase_support import PhaseSupport
from wbc.spatial import vech
from wbc.tasks import InertiaTask, PrincipalInertiaTask, Task
from wbc.validate import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class History:
    """One row per tick: the state at its beginning, and the controller's answer.

    Attributes
    ----------
    time:
        (n,) beginning of the tick [s].
    phase:
        (n,) name of the phase; empty in a run without phases.
    support:
        (n,) contacts, separated by commas: feet by name, such as ``left,right``, or frames.
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
        (n,) distance of each contact from its anchor [m], [rad], by frame; NaN without the contact.
        The anchor is the frame's placement when the contact was made.
    margin:
        (n,) smallest distance to a joint position limit [rad or m].
    balance:
        (n,) distance of the CoM's projection inside the support polygon [m], negative outside; NaN
        unless feet and nothing else are in contact.
    clearance:
        (n,) slack of each margin, negative if violated, by constraint; NaN while it is not in use.
    clearance_unit:
        (n,) its unit, m or rad, by constraint; empty while it is not in use.
    nearest:
        (n,) the row with that slack, such as ``"left_hand vs pelvis"``, by constraint; empty while
        it is not in use.
    active:
        (n,) whether a row was active, by the label of each that ever was; see
        :func:`holding_rows`.
    points, targets:
        (n, 3) the point that each task with a target in space moves, and that target [m], by task;
        NaN while the task is off.
    obstacles:
        Shape and place of each obstacle, such as ``room/wall``.
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
    task_inertia: Mapping[str, Array] = field(default_factory=dict)
    errors: Mapping[str, Array] = field(default_factory=dict)
    slip: Mapping[str, Array] = field(default_factory=dict)
    turn: Mapping[str, Array] = field(default_factory=dict)
    margin: Array
    balance: Array
    clearance: Mapping[str, Array] = field(default_factory=dict)
    clearance_unit: Mapping[str, NDArray[np.str_]] = field(default_factory=dict)
    nearest: Mapping[str, NDArray[np.str_]] = field(default_factory=dict)
    active: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)
    points: Mapping[str, Array] = field(default_factory=dict)
    targets: Mapping[str, Array] = field(default_factory=dict)
    obstacles: Mapping[str, ObstacleTrack] = field(default_factory=dict)
    kkt: Array
    tick_time: Array
    tick_cpu_time: Array
    status: NDArray[np.str_]

    def __repr__(self) -> str:
        span = f", {self.time[0]:g} to {self.time[-1]:.4g} s" if len(self) else ""
        return f"History({len(self)} ticks{span})"

    def __len__(self) -> int:
        return int(self.time.size)

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return every array by a flat name; those by task or frame as ``errors/com``.

        An obstacle has several: ``obstacles/room/wall/place`` and so on.
        """
        flat: dict[str, NDArray[np.generic]] = {}
        for part in fields(self):
            value = getattr(self, part.name)
            for name, entry in value.items() if isinstance(value, Mapping) else ((None, value),):
                key = part.name if name is None else f"{part.name}/{name}"
                if isinstance(entry, ObstacleTrack):
                    flat |= {f"{key}/{end}": array for end, array in entry.arrays().items()}
                else:
                    flat[key] = entry
        return flat


class StateRecord(NamedTuple):
    """Quantities measured at a state, besides the controller's diagnostics."""

    com: Array  # (3,)
    inertia: Array  # (6,)
    task_inertia: dict[str, Array]  # (6,)
    slip: dict[str, float]
    turn: dict[str, float]
    margin: float
    margin_joint: str
    balance: float  # NaN without feet in contact
    clearance: dict[str, float]
    clearance_unit: dict[str, str]
    nearest: dict[str, str]  # the row of the clearance


class HistoryRecorder:
    """Measures states and collects ticks.

    ``states``: the states that a run is judged by: measured at the beginning of each tick, or true.
    ``failures``: why there was no solution, by tick.
    ``standings``: contacts and margins of each tick.
    ``left_out``: number of ticks in which each part was skipped, for lack of time or of a level's
    solution.
    """

    def __init__(self, robot: Robot, tasks: Iterable[Task]) -> None:
        self.states: list[StateRecord] = []
        self.failures: dict[int, str] = {}
        self.standings: list[PhaseSupport] = []
        self.left_out: Counter[str] = Counter()
        # Rows of the history by tick, without snapshots and QPs, which are a hundred times larger.
        self._rows: list[dict[str, Any]] = []
        self._tasks = tuple(tasks)
        self._shapes: dict[str, Shape] = {}
        self._limits = Limits(robot)  # only to read the margin: also in a run without limits
        self._inertia_axes = {
            task.name: (task.frame, task.about) if isinstance(task, InertiaTask) else (BASE, COM)
            for task in self._tasks
            if isinstance(task, InertiaTask | PrincipalInertiaTask)
        }

    def add(
        self,
        now: LoopTick,
        standing: PhaseSupport,
        errors: Mapping[str, Array] | None = None,
        truth: Snapshot | None = None,
    ) -> None:
        """Record a tick.

        ``errors``: of the tasks, by name; by default those that the tick reports.
        ``truth``: the true state, if known, by which the run is judged. The history has the
        measured one.
        """
        tick, state = now.tick, self.measure(now.snapshot, standing)
        if not tick.ok:
            self.failures[len(self.states)] = tick.report()
        self.left_out.update(tick.left_out)
        actual = now.snapshot if truth is None else truth
        self.states.append(state if actual is now.snapshot else self.measure(actual, standing))
        self.standings.append(standing)
        errors = tick.errors if errors is None else errors
        aims = {
            task.name: aim
            for task in self._tasks
            if task.name in errors and (aim := task.aim(now.snapshot)) is not None
        }
        obstacles, kkt = dict(obstacles_of(standing.margins)), tick.solution.residuals
        self._shapes |= {name: one.shape for name, one in obstacles.items()}
        self._rows.append(
            {
                **state._asdict(),
                "time": now.time,
                "phase": standing.phase,
                "support": standing.label,
                "q": now.snapshot.q,
                "v": tick.velocity,
                "errors": errors,
                "active": dict.fromkeys(holding_rows(tick), True),
                "points": {name: aim.point for name, aim in aims.items()},
                "targets": {name: aim.wanted for name, aim in aims.items()},
                "obstacles": {name: place_of(one) for name, one in obstacles.items()},
                "kkt": max(kkt.primal, kkt.dual, kkt.complementarity) if tick.ok else np.nan,
                "tick_time": now.seconds,
                "tick_cpu_time": now.cpu_seconds,
                "status": tick.status.value,
            }
        )

    def last_error(self, task: Task) -> Array:
        """Return the error (k,) of the last tick with a task; NaN if there was none."""
        rows = (row["errors"] for row in reversed(self._rows))
        last = next((errors[task.name] for errors in rows if task.name in errors), None)
        return np.full(len(task.reported_rows), np.nan) if last is None else last

    def measure(self, snapshot: Snapshot, standing: PhaseSupport) -> StateRecord:
        """Return what the summary needs of a state."""
        errors = {contact.frame: contact.residual(snapshot).error for contact in standing.contacts}
        margin, joint = self._limits.worst_margin(snapshot.q)
        clearance = standing.clearance(snapshot)
        return StateRecord(
            com=snapshot.com,
            inertia=vech(snapshot.inertia),
            task_inertia={
                name: vech(snapshot.inertia_in(*axes)) for name, axes in self._inertia_axes.items()
            },
            slip={frame: float(np.linalg.norm(drift[:3])) for frame, drift in errors.items()},
            turn={frame: float(np.linalg.norm(drift[3:])) for frame, drift in errors.items()},
            margin=margin,
            margin_joint=joint,
            balance=standing.margin(snapshot),
            clearance={name: value for name, (value, _, _) in clearance.items()},
            clearance_unit={name: unit for name, (_, _, unit) in clearance.items()},
            nearest={name: where for name, (_, where, _) in clearance.items()},
        )

    def history(self) -> History:
        """Return everything recorded, as arrays."""
        names = (part.name for part in fields(History))
        columns = {name: _column([row[name] for row in self._rows]) for name in names}
        columns["obstacles"] = {
            name: ObstacleTrack(self._shapes[name], place)
            for name, place in columns["obstacles"].items()
        }
        return History(**columns)


def holding_rows(tick: Tick) -> tuple[str, ...]:
    """Return the labels of active rows: ``tick.active``, then joints at a bound of their velocity.

    Such a bound comes from a limit of position, speed or acceleration: ``left_knee lower bound``.
    """
    if not tick.ok:
        return ()
    return (*tick.active, *(f"{name} {side} bound" for name, side, _ in held_joints(tick)))


class HeldJoint(NamedTuple):
    """A joint at a bound of its velocity, ``lower`` or ``upper``, and the bound's multiplier."""

    name: str
    side: str
    pull: float


def held_joints(tick: Tick) -> list[HeldJoint]:
    """Return the joints at an active bound, in the robot's order; none if the tick failed."""
    if not tick.ok:
        return []
    multipliers = tick.solution.z_box[: tick.velocity.size]
    threshold = max(NEGLIGIBLE, ACTIVE * float(np.abs(tick.solution.z_box).max(initial=0.0)))
    names = tick.qp.labels.variables
    return [
        HeldJoint(
            names[k], "upper" if multipliers[k] > 0.0 else "lower", abs(float(multipliers[k]))
        )
        for k in np.flatnonzero(np.abs(multipliers) > threshold).tolist()
    ]


def _column(rows: Sequence[Any]) -> Any:
    """Return an array, or one array per name; missing entries are NaN, "" or False."""
    if not isinstance(rows[0], Mapping):
        return np.array(rows)
    fillers = {name: _filler(value) for row in rows for name, value in row.items()}
    return {
        name: np.array([row.get(name, filler) for row in rows]) for name, filler in fillers.items()
    }


def _filler(like: Any) -> Any:
    if isinstance(like, bool | str):
        return type(like)()
    return np.full(np.shape(like), np.nan)
