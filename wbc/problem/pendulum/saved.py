"""Results of pendulums' problems read back from files, to be drawn again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError
from wbc.problem.pendulum.result import PendulumHistory, PendulumResult, Support

PLACES = ("com", "com_velocity", "foot", "cop", "cmp", "radii", "momentum")


@dataclass(frozen=True, eq=False)
class SavedPendulum:
    """A pendulum's motion, as it was or as its file tells."""

    name: str  # what to call it
    history: PendulumHistory
    summary: Mapping[str, Any]  # what PendulumResult.summary returned

    @classmethod
    def of(cls, result: PendulumResult, name: str) -> SavedPendulum:
        """Return what a file with the result would give."""
        return cls(name, result.history, result.summary())


def pendulum_of(
    path: Path, arrays: Mapping[str, NDArray[Any]], summary: Mapping[str, Any]
) -> SavedPendulum:
    """Return the motion that arrays of a file hold.

    Raises
    ------
    InvalidInputError
        Arrays are missing or do not fit together.
    """
    needed = [each.name for each in fields(PendulumHistory) if each.name != "supports"]
    missing = [name for name in (*needed, "support_times") if name not in arrays]
    if missing:
        raise InvalidInputError(f"{path}: lacks the array {missing[0]!r}")
    count = np.size(arrays["time"])
    shapes = {"time": (count,), "phase": (count,), "axes": (count, 3, 3)}
    shapes |= dict.fromkeys(PLACES, (count, 3))
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
