"""Writing a series: everything as .npz, or flat columns as .csv; whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError
from wbc.files import write_whole
from wbc.spatial import COMPONENTS
from wbc.validate import Array

FORMATS = (".npz", ".csv")
_XYZ, _123 = ("_x", "_y", "_z"), ("_1", "_2", "_3")
# Columns of the CSV: array, endings of its columns, units of them (one for all, or two halves).
_COLUMNS: tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...] = (
    ("time", ("",), ("s",)),
    ("com", _XYZ, ("m",)),
    ("com_velocity", _XYZ, ("m/s",)),
    ("com_acceleration", _XYZ, ("m/s^2",)),
    ("momentum", (*_XYZ, *(f"_k{a}" for a in "xyz")), ("kg m/s", "kg m^2/s")),
    ("momentum_rate", (*_XYZ, *(f"_k{a}" for a in "xyz")), ("N", "N m")),
    ("ground_force", _XYZ, ("N",)),
    ("ground_moment", ("",), ("N m",)),
    ("cop", _XYZ, ("m",)),
    ("cmp", _XYZ, ("m",)),
    ("cop_margin", ("",), ("m",)),
    ("flight", ("",), ("1",)),
    ("leg_length", ("",), ("m",)),
    ("leg_direction", _XYZ, ("1",)),
    ("leg_angles", ("_theta", "_phi"), ("rad",)),
    ("inertia", tuple(f"_{component}" for component in COMPONENTS), ("kg m^2",)),
    ("second_moments", _123, ("kg m^2",)),
    ("semi_axes", _123, ("m",)),
    ("radii", _123, ("m",)),
    ("axes", tuple(f"_{k}{a}" for a in "xyz" for k in "123"), ("1",)),
    ("axes_defined", _123, ("1",)),
    ("average_angular_velocity", _XYZ, ("rad/s",)),
    ("axes_angular_velocity", _XYZ, ("rad/s",)),
)


def series_format(path: str | Path) -> str:
    """Return the ending of a series' file.

    Raises
    ------
    InvalidInputError
        Neither ``.npz`` nor ``.csv``.
    """
    ending = Path(path).suffix.lower()
    if ending not in FORMATS:
        raise InvalidInputError(
            f"{path}: a series is written as .npz (everything) or .csv (the pendulum)"
        )
    return ending


def save_npz(
    path: Path, summary: Mapping[str, Any], arrays: Mapping[str, NDArray[np.generic]]
) -> None:
    """Write a summary and arrays; OSError if that fails."""
    text = json.dumps(summary, indent=2, allow_nan=False)
    entries: dict[str, Any] = {"summary": np.array(text), **arrays}
    write_whole(path, lambda file: np.savez_compressed(file, **entries))


def save_csv(path: Path, arrays: Mapping[str, Array], feet: Sequence[str]) -> None:
    """Write the pendulum's columns, nine digits each; OSError if that fails."""
    header, parts = list[str](), list[Array]()
    for name, endings, units in _COLUMNS:
        if name in arrays:
            each = [units[k * len(units) // len(endings)] for k in range(len(endings))]
            header += [f"{name}{end} [{unit}]" for end, unit in zip(endings, each, strict=True)]
            parts.append(arrays[name].reshape(len(arrays[name]), -1))
    header += [f"{foot}_stands [1]" for foot in feet]
    parts.append(arrays["standing"])
    rows = np.column_stack(parts)
    write_whole(
        path,
        lambda file: np.savetxt(
            file, rows, delimiter=",", fmt="%.9g", header=",".join(header), comments=""
        ),
    )
