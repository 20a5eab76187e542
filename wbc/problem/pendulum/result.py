"""The result of a pendulum's problem: its motion in space and measures, saved and loaded."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError
from wbc.notebook import as_html, with_picture
from wbc.run.columns import Frame, frame_of
from wbc.run.saving import save_result
from wbc.validate import Array

FORMAT = "wbc pendulum result 1"
# Units of vectors (n, 3) of a history.
VECTORS = {
    "com": "m", "com_velocity": "m/s", "foot": "m", "cop": "m", "cmp": "m",
    "momentum": "kg m^2/s",
}  # fmt: skip
# Units of measures, by the last words of their names; others have none.
UNITS = {
    "leg": "rad",
    "leg_rate": "rad/s",
    "wheel_rate": "rad/s",
    "worst_leg": "rad",
    "spin": "rad/s",
    "cop": "m",
    "leg_force": "N",
    "leg_length": "m",
    "wheel_torque": "N m",
    "wheel_angle": "rad",
    "radius": "m",
    "seconds": "s",
    "duration": "s",
    "momentum drift in flight": "kg m^2/s",
}


def unit_of(measure: str) -> str:
    """Return the unit of a measure by its name; empty if it has none."""
    return UNITS.get(measure.removeprefix("margin to "), "")


class Support(NamedTuple):
    """A support polygon, and the time for which it lasts."""

    start: float  # [s]
    end: float  # [s]
    polygon: Array  # (k, 2) [m], anticlockwise; two corners for a planar pendulum


@dataclass(frozen=True, eq=False)
class PendulumHistory:
    """A pendulum's motion in space (x, y, z), z up; a planar one moves in y = 0."""

    flat: bool  # whether the pendulum is planar
    time: Array  # (n,) [s]
    phase: tuple[str, ...]  # the phase's name in the law or the schedule at each time (n,)
    com: Array  # (n, 3) [m]
    com_velocity: Array  # (n, 3) [m/s]
    foot: Array  # lower end of the leg (n, 3) [m]; NaN in flight
    # Both NaN in flight, and at the end of a simulation, where there is no command.
    cop: Array  # where the ground pushes (n, 3) [m]
    cmp: Array  # where its force, moved to the CoM, meets the ground (n, 3) [m]
    radii: Array  # distances r_k of the masses (n, 3) [m]; a planar pendulum has (r, 0, 0)
    axes: Array  # axes of the masses as columns of rotation matrices (n, 3, 3)
    momentum: Array  # angular momentum k_G about the CoM (n, 3) [kg m^2/s]
    supports: tuple[Support, ...]  # support polygons, in order of time


class PendulumStatus(StrEnum):
    """How a run ended.

    ``COMPLETED``: it stood for the whole time, met every tolerance and kept every bound.
    ``PLANNED``: a plan was found and checked. ``NOT_REACHED``: a tolerance was not met, or a bound
    was violated on the way. ``PLAN_BROKEN``: the plan violates its limits when checked at twice the
    knots. ``INTERRUPTED``: it was cancelled. The others: the simulation ended early.
    """

    COMPLETED = "completed"
    PLANNED = "planned"
    NOT_REACHED = "not_reached"
    PLAN_BROKEN = "plan_broken"
    FELL = "fell"
    CONTACT_LOST = "contact_lost"
    LAW_FAILED = "law_failed"
    DIVERGED = "diverged"
    INTERRUPTED = "interrupted"

    @property
    def good(self) -> bool:
        """True if the problem was solved."""
        return self in (PendulumStatus.COMPLETED, PendulumStatus.PLANNED)


@dataclass(frozen=True, eq=False)
class PendulumResult:
    """The result of a pendulum's problem."""

    # status and reason: how it ended, and why in words.
    status: PendulumStatus
    reason: str
    # In SI units. For a simulation: those that stop.accept can limit, under its names, and for each
    # bound "margin to ...", negative where it was violated.
    measures: Mapping[str, float]
    history: PendulumHistory  # the motion in space
    arrays: Mapping[str, NDArray[np.generic]]  # further arrays of the .npz file
    provenance: Mapping[str, Any]  # problem text, overrides and versions

    def __repr__(self) -> str:
        return f"PendulumResult({self.status.value}, {len(self.history.time)} times)"

    def summary(self) -> dict[str, Any]:
        """Return everything but the motion as plain data, which ``save`` writes as JSON."""
        return {
            "format": FORMAT,
            "status": self.status.value,
            "reason": self.reason,
            "measures": dict(self.measures),
            **self.provenance,
        }

    def save(self, path: str | Path) -> None:
        """Write the summary as ``.json``, summary and motion as ``.npz``, or a table.

        Errors and guarantees are as for :func:`wbc.run.saving.save_result`.
        """
        save_result(path, self.summary(), lambda: {**self._motion(), **self.arrays}, self._columns)

    def to_frame(self) -> Frame:
        """Return the motion as a pandas data frame: a row per time, the columns of a table.

        Raises MissingPackageError: pandas is not installed.
        """
        return frame_of(self._columns())

    def _repr_html_(self) -> str:
        rows = [(name, f"{value:.4g} {unit_of(name)}") for name, value in self.measures.items()]
        table = as_html(f"{self.status.value.replace('_', ' ')}: {self.reason}", (), rows)
        return with_picture(table, "wbc.view.pendulum:pendulum_figure", self.history)

    def _columns(self) -> list[tuple[str, Array]]:
        """Return the columns of a table of the motion, with their units."""
        motion = self.history
        columns = [("time [s]", motion.time)]
        for name, unit in VECTORS.items():
            values = getattr(motion, name)
            columns += [(f"{name}/{axis} [{unit}]", values[:, k]) for k, axis in enumerate("xyz")]
        return [*columns, *((f"radius/{k + 1} [m]", motion.radii[:, k]) for k in range(3))]

    def _motion(self) -> dict[str, NDArray[np.generic]]:
        plain = {
            each.name: np.asarray(getattr(self.history, each.name))
            for each in fields(self.history)
            if each.name != "supports"
        }
        for k, support in enumerate(self.history.supports):
            plain[f"support_{k}"] = support.polygon
        spans = [(support.start, support.end) for support in self.history.supports]
        return {**plain, "support_times": np.array(spans).reshape(-1, 2)}


# ---------------------------------------------------------------------- read back from files


@dataclass(frozen=True, eq=False)
class SavedPendulum:
    """A pendulum's motion and summary, from a result or from its file."""

    name: str  # for titles
    history: PendulumHistory
    summary: Mapping[str, Any]  # as PendulumResult.summary returns it

    @classmethod
    def of(cls, result: PendulumResult, name: str) -> SavedPendulum:
        """Return a result as if it were loaded from its file."""
        return cls(name, result.history, result.summary())


def motion_names(names: Iterable[str]) -> list[str]:
    """Return the names of a file's arrays that are the motion's; a plan's file has others, too."""
    own = {each.name for each in fields(PendulumHistory)}
    return [name for name in names if name in own or name.startswith("support_")]


def pendulum_of(
    path: Path, arrays: Mapping[str, NDArray[Any]], summary: Mapping[str, Any]
) -> SavedPendulum:
    """Return the motion from a file's arrays.

    Raises InvalidInputError: arrays are missing or do not fit together.
    """
    needed = [each.name for each in fields(PendulumHistory) if each.name != "supports"]
    missing = [name for name in (*needed, "support_times") if name not in arrays]
    if missing:
        raise InvalidInputError(f"{path}: lacks the array {missing[0]!r}")
    count = np.size(arrays["time"])
    shapes = {"time": (count,), "phase": (count,), "axes": (count, 3, 3)}
    shapes |= dict.fromkeys((*VECTORS, "radii"), (count, 3))
    for name, shape in shapes.items():
        if arrays[name].shape != shape or not count:
            raise InvalidInputError(
                f"{path}: array {name!r}: expected shape {shape}, got {arrays[name].shape}"
            )
    spans = arrays["support_times"].reshape(-1, 2).tolist()
    try:
        polygons = [arrays[f"support_{k}"] for k in range(len(spans))]
    except KeyError as error:
        raise InvalidInputError(f"{path}: lacks the array {error}") from None
    values: dict[str, Any] = {name: arrays[name] for name in needed}
    values["flat"] = bool(arrays["flat"])
    values["phase"] = tuple(str(one) for one in arrays["phase"])
    supports = tuple(
        Support(start, end, each) for (start, end), each in zip(spans, polygons, strict=True)
    )
    return SavedPendulum(path.stem, PendulumHistory(**values, supports=supports), summary)
