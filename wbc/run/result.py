"""The result of a run, with its history."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wbc.errors import listed
from wbc.notebook import as_html, with_picture
from wbc.robot import Robot
from wbc.run.columns import Column, Frame, frame_of, history_columns
from wbc.run.history import History, StateRecord
from wbc.run.saving import plain, save_result
from wbc.run.shaping_report import ShapingReport
from wbc.run.stopping import RunStatus
from wbc.validate import Array

FORMAT = "wbc result 1"
SHOWN_FAILURES = 5
REACHED_TOLERANCE = 0.01  # relative error of an inertia that counts as reached


@dataclass(frozen=True, eq=False)
class TaskResult:
    """A task at the end of a run."""

    error: Array  # (k,) actual minus target
    # rows and units: names and units of its entries.
    rows: tuple[str, ...]
    units: tuple[str, ...]
    tolerance: float | None = None  # on the norm of the error, if the problem gives one

    @property
    def norm(self) -> float:
        """Norm of the error; mixes units where the rows do."""
        return float(np.linalg.norm(self.error))


@dataclass(frozen=True, eq=False)
class InertiaReading:
    """An inertia task's quantity, in kg m^2 and as plain entries of the matrix."""

    axes: str  # the frame whose axes these are; principal for principal moments
    about: str | tuple[float, ...]  # com, world, a frame, or a point of the world [m]
    components: tuple[str, ...]  # names of the entries below
    # (k,) at the start, the target at the end of its ramp, and at the end of the run.
    start: Array
    wanted: Array
    reached: Array

    def share(self, k: int) -> float:
        """Return the ratio of reached to wanted of an entry."""
        return float(self.reached[k] / self.wanted[k]) if self.wanted[k] else float("nan")

    @property
    def arrived(self) -> bool:
        """Whether the target was reached to a hundredth."""
        error = np.linalg.norm(self.reached - self.wanted)
        return bool(error <= REACHED_TOLERANCE * np.linalg.norm(self.wanted))


@dataclass(frozen=True)
class Worst:
    """The worst value of something over a run, where, and at which tick (counted from 0)."""

    value: float
    where: str
    tick: int
    unit: str = "m"


@dataclass(frozen=True)
class HeldBack:
    """Number of ticks in which a row was active, and times of the first and last of them [s].

    A row is a limit of a joint, a pair of bodies, an edge of the support and so on.
    """

    ticks: int
    first: float
    last: float


@dataclass(frozen=True)
class PhaseResult:
    """A phase: its beginning [s], its contacts, and its smallest balance margin [m]."""

    begins: float
    support: str
    balance: float


@dataclass(frozen=True, eq=False)
class Failure:
    """A tick without solution."""

    tick: int
    report: str


@dataclass(frozen=True, eq=False)
class Result:
    """The result of a run.

    Attributes
    ----------
    status, reason:
        How it ended, and why, in words.
    q, v:
        Configuration (nq,) and velocity (nv,) at the end.
    final:
        Quantities measured there.
    tasks, inertia:
        Each task at the end by name, and the quantities of inertia tasks.
    margin:
        Smallest distance to a joint position limit [rad or m]; the tick ``len(history)`` is the
        end of the run.
    slip:
        Largest distance of a contact from its anchor [m]; None without contacts.
    balance:
        Smallest distance of the CoM's projection inside the support polygon [m], negative outside,
        and its phase; None if the robot never stood on feet alone.
    clearance:
        Smallest slack of each margin, negative if violated, its row and unit, by the name of the
        constraint.
    yielding:
        Names of the soft constraints.
    held_back:
        Active inequality rows and bounds of joints and how long they were active, by their labels,
        the longest first.
    not_kept:
        Conditions of :class:`Stop` that were violated in some tick, in words.
    phases:
        The phases by name, in order; empty in a run without phases.
    failures:
        Every tick without solution.
    left_out:
        What ticks skipped, as their deadline was over or a level not solved, and in how many.
    history:
        Every tick.
    provenance:
        Problem text, overrides and versions.
    shaping:
        The search of the method ``global``.
    """

    robot: Robot
    status: RunStatus
    reason: str
    q: Array
    v: Array
    final: StateRecord
    tasks: Mapping[str, TaskResult]
    inertia: Mapping[str, InertiaReading]
    margin: Worst
    slip: Worst | None
    balance: Worst | None
    clearance: Mapping[str, Worst]
    yielding: frozenset[str]
    held_back: Mapping[str, HeldBack]
    not_kept: tuple[str, ...]
    phases: Mapping[str, PhaseResult]
    failures: tuple[Failure, ...]
    left_out: Mapping[str, int]
    history: History
    provenance: Mapping[str, Any]
    shaping: ShapingReport | None = None

    def __repr__(self) -> str:
        contents = f"{len(self.history)} ticks, {len(self.tasks)} tasks"
        return f"Result({self.status.value}, {self.robot.name!r}, {contents})"

    @property
    def worst_kkt(self) -> float:
        """Largest KKT residual of the solved ticks; NaN if there is none."""
        solved = self.history.kkt[np.isfinite(self.history.kkt)]
        return float(solved.max()) if solved.size else float("nan")

    @property
    def dt(self) -> float:
        """Time step of the run [s]; 0 of a run of one tick."""
        return float(self.history.time[1] - self.history.time[0]) if len(self.history) > 1 else 0.0

    @property
    def held_at_end(self) -> tuple[str, ...]:
        """Labels of the rows and bounds active in the last tick, the longest active first."""
        active = self.history.active
        return tuple(name for name in self.held_back if name in active and active[name][-1])

    @property
    def reach(self) -> str:
        """How near a robot at rest came to an inertia that it does not reach, in words; else empty.

        Such as "as far as its joints and other tasks allow: shape 20 to 45 % of what is wanted,
        at left_knee lower bound". A run without one of them tells which it is.
        """
        short = {name: one for name, one in self.inertia.items() if not one.arrived}
        active = self.held_at_end
        if self.status is not RunStatus.CONVERGED or not short:
            return ""
        bounds = [name.endswith(" bound") for name in active]
        limits = ["joints"] * any(bounds) + ["margins"] * (not all(bounds))
        limits += ["other tasks"] * (len(self.tasks) > 1)
        parts = []
        for name, one in short.items():
            shares = sorted(
                100 * one.share(k) for k in range(len(one.components)) if one.wanted[k] > 0.0
            )
            if shares:
                extremes = dict.fromkeys((f"{shares[0]:.0f}", f"{shares[-1]:.0f}"))
                parts.append(f"{name} {' to '.join(extremes)} % of what is wanted")
        shares_text = "; ".join(parts) or "a nearest inertia"
        who = " and ".join(limits) or "small motions"
        where = listed(active, 2) or "no limit (outweighed, or no small motion changes it)"
        return f"as far as its {who} allow: {shares_text}, at {where}"

    def tick_times(self) -> dict[str, dict[str, float]]:
        """Return median, 99th percentile and maximum of the tick's wall and CPU time [s]."""
        both = {"wall": self.history.tick_time, "cpu": self.history.tick_cpu_time}
        return {
            name: {
                "median": float(np.median(times)),
                "p99": float(np.percentile(times, 99)),
                "max": float(times.max()),
            }
            for name, times in both.items()
        }

    def summary(self) -> dict[str, Any]:
        """Return everything but the history as plain data; what ``save`` writes as JSON."""
        return {
            "format": FORMAT,
            "status": self.status.value,
            "reason": self.reason,
            "reach": self.reach,
            "ticks": len(self.history),
            "robot": self.robot.name,
            "final": self._final(),
            "tasks": {name: {"norm": one.norm, **plain(one)} for name, one in self.tasks.items()},
            "inertia": {
                name: {"unit": "kg m^2", **plain(one)} for name, one in self.inertia.items()
            },
            "joint_limits": {
                "smallest_margin": self.margin.value,
                "joint": self.margin.where,
                "tick": self.margin.tick,
            },
            "slip": self.slip
            and {"largest": self.slip.value, "frame": self.slip.where, "tick": self.slip.tick},
            "balance": self.balance
            and {
                "least_margin": self.balance.value,
                "phase": self.balance.where,
                "tick": self.balance.tick,
            },
            "constraints": {
                name: {
                    "least_clearance": worst.value,
                    "unit": worst.unit,
                    "at": worst.where,
                    "tick": worst.tick,
                    "time": worst.tick * self.dt,
                    "may_give_way": name in self.yielding,
                }
                for name, worst in self.clearance.items()
            },
            "held_back": {
                label: {"seconds": one.ticks * self.dt, **plain(one)}
                for label, one in self.held_back.items()
            },
            "not_kept": list(self.not_kept),
            "phases": plain(self.phases),
            "qp": {
                "failed_ticks": len(self.failures),
                "worst_kkt_residual": self.worst_kkt,
                "left_out": dict(self.left_out),
                "failures": plain(self.failures[:SHOWN_FAILURES]),
            },
            "tick_time": self.tick_times(),
            "shaping": self.shaping and self.shaping.summary(),
            **self.provenance,
        }

    def _final(self) -> dict[str, Any]:
        joints = self.robot.limits.joint_positions(self.q)
        return dict(
            plain(
                {
                    "q": self.q,
                    "joints": dict(zip(self.robot.joint_names, joints, strict=True)),
                    "v": self.v,
                    "com": self.final.com,
                    "inertia_world": self.final.inertia,
                }
            )
        )

    def save(self, path: str | Path) -> None:
        """Write the summary (.json), with the history (.npz), or a table (.csv, .parquet).

        Errors and guarantees are those of :func:`wbc.run.saving.save_result`; for the table see
        :func:`wbc.run.columns.history_columns`. An ``.npz`` also names its joints, ``joint_names``.
        """
        names = np.array(self.robot.joint_names, dtype=str)
        save_result(
            path,
            self.summary(),
            lambda: {"joint_names": names, **self.history.arrays()},
            self._columns,
        )

    def to_frame(self) -> Frame:
        """Return the history as a pandas data frame: a row per tick, the columns of a table.

        Raises
        ------
        MissingPackageError
            pandas is not installed.
        """
        return frame_of(self._columns())

    def _columns(self) -> list[Column]:
        rows = {
            name: [f"{row} [{unit}]" for row, unit in zip(task.rows, task.units, strict=True)]
            for name, task in self.tasks.items()
        }
        return history_columns(self.robot, self.history, rows)

    def _repr_html_(self) -> str:
        """Return the HTML of a notebook."""
        errors = [
            (name, f"{task.norm:.3g} {', '.join(dict.fromkeys(task.units))}")
            for name, task in self.tasks.items()
        ]
        active = listed([f"{name} for {one.ticks * self.dt:.2f} s" for name, one in
                       self.held_back.items()])  # fmt: skip
        facts = [
            ("robot", self.robot.name),
            ("ran", f"{len(self.history)} ticks of {self.dt:g} s"),
            ("held back by", active),
            ("not kept", "; ".join(self.not_kept)),
            ("failed ticks", str(len(self.failures) or "")),
        ]
        reach = f", {self.reach}" if self.reach else ""
        title = f"{self.status.value.replace('_', ' ')}: {self.reason}{reach}"
        table = as_html(title, facts, [(f"error of {name}", text) for name, text in errors])
        return with_picture(table, "wbc.view.run:run_figure", self.robot, self.history)
