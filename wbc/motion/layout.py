"""What the columns of a recording mean: time, joints, the floating base; and in which unit."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.motion.errors import RecordingError, UnknownColumnError
from wbc.motion.table import Table
from wbc.robot import Robot
from wbc.robot.series import turning_joints
from wbc.validate import Array

TIME = ("time", "t")
PLACE = ("base_x", "base_y", "base_z")
QUATERNION = ("base_qx", "base_qy", "base_qz", "base_qw")
ANGLES = ("base_roll", "base_pitch", "base_yaw")
UNIT = 1e-2  # how far the norm of a recorded quaternion may be from 1: two decimals are enough
_BRACKETS = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>[^\[\]()]*)[\])]")
_SUFFIX = re.compile(r"(?P<name>.*)_(?P<unit>deg|rad)")


@dataclass(frozen=True)
class Column:
    """A column of the file: where it is, and the unit that its name tells."""

    index: int
    unit: str | None


def configuration_columns(robot: Robot) -> tuple[str, ...]:
    """Return names for the entries of q; a continuous joint has two, ``cos`` and ``sin``."""
    names = [*PLACE, *QUATERNION]
    for k, name in enumerate(robot.joint_names):
        names += [f"cos {name}", f"sin {name}"] if k in robot.limits.unbounded else [name]
    return tuple(names)


def with_angles(table: Table, robot: Robot) -> Table:
    """Return the table with the (cos, sin) of continuous joints replaced by their angles."""
    columns, values = list(table.columns), table.values
    for k in robot.limits.unbounded:
        name = robot.joint_names[k]
        if f"cos {name}" in columns and f"sin {name}" in columns:
            c, s = (columns.index(f"{part} {name}") for part in ("cos", "sin"))
            values = values.copy()
            values[:, c] = np.arctan2(values[:, s], values[:, c])
            columns[c] = name
            values, columns = np.delete(values, s, axis=1), columns[:s] + columns[s + 1 :]
    return Table(table.source, tuple(columns), values, table.lines)


def understood(table: Table, robot: Robot, ignore: Sequence[str]) -> dict[str, Column]:
    """Return the columns by what they hold: ``time``, a joint, or one of the base's names.

    Parameters
    ----------
    ignore:
        Columns to pass over; shell-style patterns.

    Raises
    ------
    UnknownColumnError
        A column that is none of these, with the nearest that is.
    RecordingError
        Two columns that hold the same, or a column without a name.
    """
    known = {*TIME, *PLACE, *QUATERNION, *ANGLES, *robot.joint_names}
    found: dict[str, Column] = {}
    for k, header in enumerate(table.columns):
        if any(fnmatchcase(header, pattern) for pattern in ignore):
            continue
        if not header:
            if np.isnan(table.values[:, k]).all():  # every line ends with a delimiter
                continue
            what = f"column {k + 1} has no name; give it one, or pass it over: ignore = ''"
            raise RecordingError(what, table.source)
        name, unit = _split(header, known)
        name = name.lower() if name.lower() in TIME else name
        if name not in known:
            choices = {"time", *robot.joint_names, *PLACE, *QUATERNION}
            raise UnknownColumnError(table.source, name, choices)
        name = "time" if name in TIME else name
        if name in found:
            other = table.columns[found[name].index]
            raise table.error(f"it holds the same as {other!r}; remove one", k)
        found[name] = Column(k, unit)
    return found


def _split(header: str, known: set[str]) -> tuple[str, str | None]:
    """Return name and unit; a name that exists is never taken for one with a unit."""
    for pattern in (_BRACKETS, _SUFFIX):
        match = pattern.fullmatch(header)
        if header not in known and match is not None:
            return match["name"], match["unit"].strip()
    return header, None


def converted(table: Table, found: dict[str, Column], robot: Robot, degrees: bool) -> Array:
    """Return the numbers (n, k) in rad, m and s.

    Raises
    ------
    RecordingError
        A unit that does not fit the column.
    """
    turning = dict(zip(robot.joint_names, turning_joints(robot), strict=True))
    values = table.values.copy()
    for name, column in found.items():
        if name in ANGLES or turning.get(name, False):
            factors = {"rad": 1.0, "deg": np.pi / 180.0, None: np.pi / 180.0 if degrees else 1.0}
        elif name in QUATERNION:
            factors = {"1": 1.0, "": 1.0, None: 1.0}
        else:
            unit = "s" if name == "time" else "m"
            factors = {unit: 1.0, f"m{unit}": 1e-3, None: 1.0}
        if column.unit not in factors:
            units = ", ".join(unit for unit in factors if unit)
            raise table.error(f"unknown unit {column.unit!r}; use {units}", column.index)
        if factors[column.unit] != 1.0:
            values[:, column.index] *= factors[column.unit]
    return values


def base_of(table: Table, values: Array, found: dict[str, Column]) -> Array | None:
    """Return the base (n, 7), position and quaternion xyzw, or None if the file has none.

    Roll, pitch and yaw turn about the fixed axes x, y, z in this order (R = Rz Ry Rx).

    Raises
    ------
    RecordingError
        Some of the base's columns are missing, or a quaternion whose norm is off by over 1e-2.
    """
    place, quaternion, angles = (
        [name for name in names if name in found] for names in (PLACE, QUATERNION, ANGLES)
    )
    if not (place or quaternion or angles):
        return None
    if quaternion and angles:
        raise RecordingError("base: give quaternions or angles, not both", table.source)
    turn = ANGLES if angles else QUATERNION
    missing = [name for name in (*PLACE, *turn) if name not in found]
    if missing:
        raise RecordingError(f"the base is not complete: {', '.join(missing)}", table.source)
    position, turned = (values[:, [found[name].index for name in part]] for part in (PLACE, turn))
    if angles:
        quaternions = np.full((len(values), 4), np.nan)
        whole = np.isfinite(turned).all(axis=1)
        quaternions[whole] = Rotation.from_euler("xyz", turned[whole]).as_quat()
        return np.hstack((position, quaternions))
    norm = np.linalg.norm(turned, axis=1)
    wrong = np.flatnonzero(np.abs(norm - 1.0) > UNIT)
    if len(wrong):
        row = int(wrong[0])
        what = f"quaternion of norm {norm[row]:.6g}, expected 1; correct it, or leave out the row"
        raise table.error(what, found["base_qx"].index, row)
    return np.hstack((position, turned / norm[:, None]))
