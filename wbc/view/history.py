"""The history of a run, checked and prepared for drawing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wbc.errors import InvalidInputError, shown
from wbc.robot import Robot
from wbc.robot.model import check_robot
from wbc.run.obstacles import ObstacleTrack
from wbc.simulation.terrain import LEVEL, Terrain
from wbc.spatial import vech
from wbc.validate import Array, finite_array
from wbc.view.portrait import Pose, TargetMark
from wbc.view.series import Series, error_series, moment_series, rows_of


class HistoryLike(Protocol):
    """The history of a run; optional parts are drawn if present, see :func:`wbc.view.plot_run`."""

    @property
    def time(self) -> ArrayLike:
        """Times (n,) [s]."""

    @property
    def q(self) -> ArrayLike:
        """Configurations (n, nq)."""

    @property
    def errors(self) -> Mapping[str, ArrayLike]:
        """Error of each task, (n, k) or (n,)."""


@dataclass(frozen=True)
class PhaseSpan:
    """A phase: its name, what was stood on, its time [s] and the row in which it has ended."""

    name: str
    support: str
    begins: float
    ends: float
    last: int

    @property
    def standing(self) -> str:
        """What was stood on, in words; empty in the air."""
        return f"on {' and '.join(self.support.split(','))}" if self.support else ""


NO_PHASE = PhaseSpan("", "", 0.0, 0.0, 0)


@dataclass(frozen=True, eq=False)
class DrawableRun:
    """The drawable data of a run.

    Parts that the history lacks are empty or None; so is ``supports`` if the contacts are unknown.
    """

    robot: Robot
    time: Array  # (n,) [s]
    q: Array  # (n, nq)
    errors: Sequence[Series]
    moments: Sequence[Series]
    phases: Sequence[PhaseSpan]
    balance: Array | None  # (n,) margin [m], NaN where there is none
    supports: Sequence[str] | None
    clearance: Mapping[str, Array]  # (n,) [m], or in the unit that is told
    clearance_unit: Mapping[str, str]
    active: Mapping[str, NDArray[np.bool_]]  # (n,)
    points: Mapping[str, Array]  # (n, 3) [m]
    targets: Mapping[str, Array]
    obstacles: Mapping[str, ObstacleTrack]
    terrain: Terrain = LEVEL  # the ground

    def pose(self, row: int, support: str | None = None, now: bool = False) -> Pose:
        """Return the pose to draw in a row.

        ``support``: what was held, if not that of the row.
        ``now``: targets are those of the row; else the last that there were.
        """
        if support is None and self.supports is not None:
            support = self.supports[row]
        held = None if support is None else support.split(",")
        stands = held is None or any(foot in held for foot in self.robot.feet)
        obstacles = [
            (track.shape, track.place[row])
            for track in self.obstacles.values()
            if np.isfinite(track.place[row]).all()
        ]
        return Pose(
            self.q[row],
            stands=stands,
            grounded=stands or bool(support) or self.robot.fixed_base,
            obstacles=obstacles,
            aims=[*self._aims(row, now)],
            terrain=self.terrain,
        )

    def phase_at(self, row: int) -> str:
        """Return the name of the phase of a row; empty in a run without phases."""
        inside = (one for one in self.phases if one.begins <= self.time[row] <= one.ends)
        return max(inside, key=lambda one: one.begins, default=NO_PHASE).name

    def _aims(self, row: int, now: bool) -> Iterator[TargetMark]:
        for name, targets in self.targets.items():
            there = np.flatnonzero(np.isfinite(targets).all(axis=1))
            point = self.points[name][row]
            if np.isfinite(point).all() and len(there):
                yield TargetMark(name, point, targets[row] if now else targets[there[-1]])


def read_history(robot: Robot, history: HistoryLike, terrain: Terrain = LEVEL) -> DrawableRun:
    """Return the drawable data of a history, on a terrain.

    Raises InvalidInputError: it is none, or empty, or its arrays do not fit together; or this is no
    robot.
    """
    check_robot("history", robot)
    if any(not hasattr(history, name) for name in ("time", "q", "errors")):
        raise InvalidInputError(f"history: expected one, as result.history, got {shown(history)}")
    count = np.size(history.time)
    if count == 0:
        raise InvalidInputError("history: it is empty; there is nothing to draw")
    time = finite_array("history: time", history.time, (count,))
    q = finite_array("history: q", history.q, (count, robot.nq))
    inertia, balance = getattr(history, "inertia", None), getattr(history, "balance", None)
    if inertia is None:
        inertia = [vech(robot.snapshot(one).inertia) for one in q]
    moments = moment_series(finite_array("history: inertia", inertia, (count, 6)))
    if balance is not None:
        balance = rows_of("balance", balance, (count,))
        balance = balance if np.isfinite(balance).any() else None
    errors = error_series(history.errors, count)
    supports = _words(history, "support", count) if hasattr(history, "support") else None
    places = {name: _rows(history, name, (count, 3)) for name in ("points", "targets")}
    if set(places["points"]) != set(places["targets"]):
        raise InvalidInputError("history: points and targets: expected those of the same tasks")
    return DrawableRun(
        robot,
        time,
        q,
        errors,
        moments,
        _phases(history, time),
        balance,
        supports,
        _rows(history, "clearance", (count,)),
        {
            name: _unit(told)
            for name, told in (getattr(history, "clearance_unit", None) or {}).items()
        },
        {name: on.astype(bool) for name, on in _rows(history, "active", (count,)).items()},
        places["points"],
        places["targets"],
        getattr(history, "obstacles", None) or {},
        terrain,
    )


def _rows(history: HistoryLike, name: str, shape: tuple[int, ...]) -> dict[str, Array]:
    """Return arrays by name, NaN where there is nothing; none if the history has none."""
    given: Mapping[str, Any] = getattr(history, name, None) or {}
    return {key: rows_of(f"{name} of {key!r}", values, shape) for key, values in given.items()}


def _unit(told: ArrayLike) -> str:
    """Return what a unit's entries say, empty while a constraint is not in use."""
    return next((str(unit) for unit in np.ravel(told) if unit), "m")


def _phases(history: HistoryLike, time: Array) -> list[PhaseSpan]:
    """Return the phases of a history in order; none if it has no phases."""
    names = _words(history, "phase", len(time))
    if not any(names):
        return []
    supports = _words(history, "support", len(time))
    firsts = [k for k in range(len(names)) if k == 0 or names[k] != names[k - 1]]
    # A phase has ended in the state with which the next one begins.
    lasts = [*firsts[1:], len(names) - 1]
    return [
        PhaseSpan(names[k], supports[k], float(time[k]), float(time[last]), last)
        for k, last in zip(firsts, lasts, strict=True)
    ]


def _words(history: HistoryLike, name: str, count: int) -> list[str]:
    """Return a word for each time, all empty if the history has none."""
    given = getattr(history, name, None)
    if given is None:
        return [""] * count
    words = [str(word) for word in np.ravel(given)]
    if len(words) != count:
        raise InvalidInputError(f"history: {name}: expected {count} words, got {len(words)}")
    return words
