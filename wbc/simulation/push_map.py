"""The push map of a campaign: the survived impulse by direction."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError
from wbc.files import read_arrays
from wbc.run.saving import save_result
from wbc.simulation.campaign import PushGrid, PushOutcome, key, outcome_of
from wbc.simulation.push_bounds import PushBounds
from wbc.validate import Array

UNTRIED, FELL, SURVIVED = -1, 0, 1
LARGEST = 100_000_000  # bytes of a summary in an .npz


@dataclass(frozen=True, eq=False)
class PushMap:
    """Outcomes of the pushes of a grid on one problem.

    Attributes
    ----------
    outcomes:
        Of the tried pushes.
    bounds:
        Theoretical, by direction.
    outline:
        The same by finer directions, for pictures.
    beside:
        Earlier outcomes of pushes outside the grid, which a file keeps.
    """

    name: str
    robot: str
    grid: PushGrid
    outcomes: Sequence[PushOutcome]
    bounds: PushBounds
    outline: PushBounds
    beside: Sequence[PushOutcome] = ()

    @cached_property
    def complete(self) -> bool:
        """Whether no push of the grid remains to be tried."""
        grid = self.grid
        return all(math.isinf(grid.next_ratio(angle, self._by_key)) for angle in grid.angles)

    @cached_property
    def _by_key(self) -> Mapping[tuple[float, float], PushOutcome]:
        return {one.key: one for one in self.outcomes}

    def outcome(self, direction: int, step: int) -> PushOutcome | None:
        """Return the outcome of a push of the grid, by its indices; None if it was not tried."""
        return self._by_key.get(key(self.grid.angles[direction], self._ratios[step]))

    def _tried_pushes(self) -> Iterator[tuple[tuple[int, int], PushOutcome]]:
        """Yield the indices (direction, ratio) and outcome of each tried push."""
        for place in np.ndindex(self.grid.directions, self._ratios.size):
            outcome = self.outcome(*place)
            if outcome is not None:
                yield place, outcome

    @cached_property
    def _ratios(self) -> Array:
        return np.asarray(self.grid.ratios)

    @cached_property
    def table(self) -> NDArray[np.int8]:
        """1 survived, 0 not, -1 not tried (n, k): by direction and ratio."""
        table = np.full((self.grid.directions, self._ratios.size), UNTRIED, dtype=np.int8)
        for place, outcome in self._tried_pushes():
            table[place] = SURVIVED if outcome.survived else FELL
        return table

    @cached_property
    def limits(self) -> Array:
        """Largest ratio (n,) up to which every push of the grid was survived; 0 if none was.

        NaN in directions in which not even the smallest push was tried.
        """
        count = np.cumprod(self.table == SURVIVED, axis=1).sum(axis=1)
        limits = np.where(count > 0, self._ratios[np.maximum(count, 1) - 1], 0.0)
        return np.where(self.tried, limits, np.nan)

    @cached_property
    def tried(self) -> NDArray[np.bool_]:
        """Whether at least the smallest push of a direction (n,) was tried."""
        return np.asarray(self.table[:, 0] != UNTRIED)

    @property
    def least(self) -> float:
        """The smallest limit of the tried directions; NaN if none was."""
        return float(self.limits[self.tried].min()) if self.tried.any() else math.nan

    @property
    def mean(self) -> float:
        """The mean limit of the tried directions; NaN if none was."""
        return float(self.limits[self.tried].mean()) if self.tried.any() else math.nan

    @cached_property
    def open_ended(self) -> NDArray[np.bool_]:
        """Whether a direction (n,) was tried without a failure: its limit is a lower bound."""
        return np.asarray((self.table != FELL).all(axis=1) & self.tried)

    def beyond(self, direction: int) -> list[float]:
        """Return the survived ratios above a failed one."""
        row = self.table[direction]
        failed = np.maximum.accumulate(row == FELL)
        return [float(ratio) for ratio in self._ratios[failed & (row == SURVIVED)]]

    def first_failure(self, direction: int) -> PushOutcome | None:
        """Return the smallest failed push of a direction."""
        columns = np.flatnonzero(self.table[direction] == FELL)
        return self.outcome(direction, int(columns[0])) if columns.size else None

    def summary(self) -> dict[str, Any]:
        """Return everything as plain data."""
        bounds, angles = self.bounds, self.grid.angles
        directions = []
        for k, angle in enumerate(angles.tolist()):
            failure = self.first_failure(k)
            unit = float(bounds.ankle[k])
            directions.append(
                {
                    "angle": angle,
                    "limit": _json_number(self.limits[k]),
                    "impulse": _json_number(self.limits[k] * unit),
                    "at_least": bool(self.open_ended[k]),
                    "survived_beyond": self.beyond(k),
                    "first_failure": None if failure is None else failure._asdict(),
                    "capture_impulse": unit,
                    "pulse_limit": float(bounds.pulse[k]) / unit,
                    "reaction_mass_limit": None
                    if bounds.wheel is None
                    else float(bounds.wheel[k]) / unit,
                }
            )
        return {
            "problem": self.name,
            "robot": self.robot,
            "complete": self.complete,
            "least": _json_number(self.least),
            "mean": _json_number(self.mean),
            "omega": bounds.omega,
            "reaction_mass": bounds.reaction_mass,
            "directions": directions,
            "outcomes": [one._asdict() for one in sorted((*self.outcomes, *self.beside))],
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays of an ``.npz``; rows are directions."""
        bounds = self.bounds
        none = np.full_like(bounds.ankle, np.nan)
        values = np.full((4, *self.table.shape), np.nan)
        for place, one in self._tried_pushes():
            values[:, *place] = one.time, one.tilt, one.slip, one.relaxed
        return {
            "angle": self.grid.angles,
            "ratio": self._ratios,
            "survived": self.table,
            "limit": self.limits,
            "capture_impulse": bounds.ankle,
            "pulse_limit": bounds.pulse / bounds.ankle,
            "reaction_mass_limit": none if bounds.wheel is None else bounds.wheel / bounds.ankle,
            **dict(zip(("time", "tilt", "slip", "relaxed"), values, strict=True)),
        }


def _json_number(value: float) -> float | None:
    """Return a number for JSON, None for NaN."""
    return None if math.isnan(value) else float(value)


def compare_maps(one: PushMap, other: PushMap) -> tuple[float, float, Array]:
    """Return the ratios of one map's limits to another's: minimum, mean, and by direction (n,).

    NaN in directions in which either survived no push of the grid; minimum and mean are over the
    others.
    """
    comparable = (one.limits > 0.0) & (other.limits > 0.0)
    ratios = np.full(comparable.shape, np.nan)
    first, second = one.limits * one.bounds.ankle, other.limits * other.bounds.ankle
    ratios[comparable] = first[comparable] / second[comparable]
    if not comparable.any():
        return math.nan, math.nan, ratios
    return float(ratios[comparable].min()), float(ratios[comparable].mean()), ratios


def save_maps(path: str | Path, maps: Sequence[PushMap], made_with: Mapping[str, Any]) -> None:
    """Write maps as ``.json``, ``.npz`` with arrays, or ``.csv`` with a row per direction.

    The arrays of the second and later problems begin with their number: ``2/limit``; so do the
    columns of a table.

    Raises InvalidInputError: another ending; OSError: the file cannot be written.
    """
    summary: dict[str, Any] = {
        "kind": "push campaign",
        "ratios": np.asarray(maps[0].grid.ratios).tolist(),
        "failures": maps[0].grid.failures,
        **made_with,
        "maps": [one.summary() for one in maps],
    }
    if len(maps) > 1:
        least, mean, times = compare_maps(maps[0], maps[1])
        summary["compared"] = {"least": least, "mean": mean, "times": times.tolist()}

    def arrays() -> dict[str, NDArray[Any]]:
        return {
            f"{prefix}{name}": values
            for prefix, one in zip(_prefixes(maps), maps, strict=True)
            for name, values in one.arrays().items()
        }

    def columns() -> list[tuple[str, Array]]:
        table = [("angle [rad]", maps[0].grid.angles)]
        for prefix, one in zip(_prefixes(maps), maps, strict=True):
            rows = one.arrays()
            monotone = np.array([not one.beyond(k) for k in range(one.grid.directions)])
            table += [
                (f"{prefix}limit [M omega d]", rows["limit"]),
                (f"{prefix}survived [N s]", rows["limit"] * rows["capture_impulse"]),
                (f"{prefix}M omega d [N s]", rows["capture_impulse"]),
                (f"{prefix}at_least", one.open_ended.astype(float)),
                (f"{prefix}monotone", monotone.astype(float)),
                (f"{prefix}pulse_limit [M omega d]", rows["pulse_limit"]),
                (f"{prefix}reaction_mass_limit [M omega d]", rows["reaction_mass_limit"]),
            ]
        return table

    save_result(path, summary, arrays, columns)


def saved_outcomes(path: Path, made_with: Mapping[str, Any]) -> Mapping[str, Sequence[PushOutcome]]:
    """Return the outcomes in a ``.json`` or ``.npz`` of :func:`save_maps`, by problem.

    None of a file that was not made of the same inputs, or cannot be read.
    """
    try:
        if path.suffix.lower() == ".npz":
            arrays = read_arrays(path, {"summary"}.intersection, lambda _: "U", LARGEST)
            told = json.loads(str(arrays["summary"]))
        else:
            told = json.loads(path.read_bytes())
        if {name: told[name] for name in made_with} != json.loads(json.dumps(made_with)):
            return {}
        return {
            str(one["problem"]): [outcome_of(outcome) for outcome in one["outcomes"]]
            for one in told["maps"]
        }
    except (OSError, ValueError, KeyError, TypeError, RecursionError, InvalidInputError):
        return {}


def _prefixes(maps: Sequence[PushMap]) -> list[str]:
    return ["" if k == 0 else f"{k + 1}/" for k in range(len(maps))]
