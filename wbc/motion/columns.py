"""The columns of a recording: meaning, units, and checks of their numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.errors import UnknownNameError
from wbc.motion.table import BASE, MotionTable, RecordingError, shortened
from wbc.robot import Robot
from wbc.robot.series import revolute_joints
from wbc.validate import Array

TIME = ("time", "t")
PLACE, QUATERNION = BASE[:3], BASE[3:]
ANGLES = ("base_roll", "base_pitch", "base_yaw")
NORM_TOLERANCE = 1e-2  # of a recorded quaternion: two decimals are enough
SUFFIXES = ("deg", "rad")
# Groups of columns that wbc run and wbc sim write beside time and configuration, GROUP/NAME.
WBC_GROUPS = frozenset(
    (
        *("velocity", "com", "inertia", "error", "target", "limits", "balance", "constraint"),
        *("held_back", "tick", "torque", "forces", "planned_forces", "wrenches", "cop"),
        *("planned_cop", "trunk"),
    )
)
WRONG_UNIT_RATIO = 10.0  # of a position to its limits: then the joint is in another unit


class UnknownColumnError(UnknownNameError):
    """The column ``name`` of a recording is none of its robot."""

    def __init__(self, file: str, name: str, choices: Iterable[str]) -> None:
        super().__init__("column", shortened(name), choices)
        self.file = file
        self.args = (
            f"{file}: {self}; correct it, or have it ignored (ignore, as in --ignore {name!r})",
        )


def configuration_columns(robot: Robot) -> tuple[str, ...]:
    """Return names for the entries of q; a continuous joint has two, ``cos`` and ``sin``."""
    names = [*PLACE, *QUATERNION]
    for k, name in enumerate(robot.joint_names):
        names += [f"cos {name}", f"sin {name}"] if k in robot.limits.unbounded else [name]
    return tuple(names)


def cos_sin_to_angles(table: MotionTable, robot: Robot) -> MotionTable:
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
    return MotionTable(table.source, tuple(columns), values, table.lines)


def kept_columns(table: MotionTable, ignore: Sequence[str]) -> list[int]:
    """Return the columns that match none of the shell-style patterns to ignore."""
    return [
        k
        for k, header in enumerate(table.columns)
        if not any(fnmatchcase(header, pattern) for pattern in ignore)
    ]


def read_columns(
    table: MotionTable, robot: Robot, ignore: Sequence[str], degrees: bool
) -> tuple[dict[str, int], Array]:
    """Return the columns of ``time``, joints and base, and all numbers in SI units.

    Parameters
    ----------
    ignore:
        Columns to ignore; shell-style patterns.
    degrees:
        Angles whose column names no unit are in degrees.

    Returns
    -------
    where:
        Column indices by quantity.
    values:
        All numbers (n, k) [rad, m, s].

    Raises
    ------
    UnknownColumnError
        A column that is none of these, with the nearest that is one.
    RecordingError
        Two columns of one quantity, one without a name, or an unknown unit.
    """
    turning = dict(zip(robot.joint_names, revolute_joints(robot), strict=True))
    known = {*TIME, *PLACE, *QUATERNION, *ANGLES, *turning}
    where, values = dict[str, int](), table.values.copy()
    for k in kept_columns(table, ignore):
        header = table.columns[k]
        if not header:
            if np.isnan(values[:, k]).all():  # every line ends with a delimiter
                continue
            what = f"column {k + 1} has no name; give it one, or ignore it: ignore = ''"
            raise RecordingError(what, table.source)
        name, unit = _split(header, known)
        name = name.lower() if name.lower() in TIME else name
        if name not in known and name.partition("/")[0] in WBC_GROUPS and "/" in name:
            continue
        if name not in known:
            choices = {"time", *robot.joint_names, *PLACE, *QUATERNION}
            raise UnknownColumnError(table.source, name, choices)
        name = "time" if name in TIME else name
        if name in where:
            other = table.columns[where[name]]
            raise table.error(f"it holds the same as {other!r}; remove one", k)
        where[name] = k
        factors = _unit_factors(name, name in ANGLES or turning.get(name, False), degrees)
        if unit not in factors:
            units = ", ".join(unit for unit in factors if unit)
            raise table.error(f"unknown unit {unit!r}; use {units}", k)
        values[:, k] *= factors[unit]
    return where, values


def _split(header: str, known: set[str]) -> tuple[str, str | None]:
    """Return name and unit; an existing name is never split."""
    if header in known:
        return header, None
    if header.endswith((")", "]")):
        start = max(header.rfind("("), header.rfind("["))
        unit = header[start + 1 : -1]
        if start >= 0 and not set(unit) & set(")]"):
            return header[:start].rstrip(), unit.strip()
    name, mark, unit = header.rpartition("_")
    return (name, unit) if mark and unit in SUFFIXES else (header, None)


def _unit_factors(name: str, is_angle: bool, degrees: bool) -> dict[str | None, float]:
    """Return factors to rad, m or s by unit; None is a column without one."""
    if is_angle:
        degree = np.pi / 180.0
        return {"rad": 1.0, "deg": degree, None: degree if degrees else 1.0}
    if name in QUATERNION:
        return {"1": 1.0, "": 1.0, None: 1.0}
    unit = "s" if name == "time" else "m"
    return {unit: 1.0, f"m{unit}": 1e-3, None: 1.0}


def read_base(table: MotionTable, values: Array, where: Mapping[str, int]) -> Array | None:
    """Return the base (n, 7), position and quaternion xyzw, or None if the file has none.

    Roll, pitch and yaw are about the fixed axes x, y, z in this order (R = Rz Ry Rx).
    """
    place, quaternion, angles = (
        [name for name in names if name in where] for names in (PLACE, QUATERNION, ANGLES)
    )
    if not (place or quaternion or angles):
        return None
    if quaternion and angles:
        raise RecordingError("base: give quaternions or angles, not both", table.source)
    rotation = ANGLES if angles else QUATERNION
    missing = [name for name in (*PLACE, *rotation) if name not in where]
    if missing:
        raise RecordingError(f"the base is not complete: {', '.join(missing)}", table.source)
    position, rotations = (values[:, [where[name] for name in part]] for part in (PLACE, rotation))
    if angles:
        quaternions = np.full((len(values), 4), np.nan)
        known = np.isfinite(rotations).all(axis=1)
        quaternions[known] = Rotation.from_euler("xyz", rotations[known]).as_quat()
        return np.hstack((position, quaternions))
    norm = np.linalg.norm(rotations, axis=1)
    wrong = np.flatnonzero(np.abs(norm - 1.0) > NORM_TOLERANCE)
    if len(wrong):
        row = int(wrong[0])
        what = f"quaternion of norm {norm[row]:.6g}, expected 1; correct it, or leave out the row"
        raise table.error(what, where["base_qx"], row)
    return np.hstack((position, rotations / norm[:, None]))


# ---------------------------------------------------------------------- checks


def check_times(table: MotionTable, time: Array, column: int) -> None:
    """Raise RecordingError if times (n,) are not finite or do not increase."""
    unknown = np.flatnonzero(~np.isfinite(time))
    if len(unknown):
        raise table.error("there is no time here; remove the row", column, int(unknown[0]))
    not_increasing = np.flatnonzero(np.diff(time) <= 0.0)
    if len(not_increasing):
        row = int(not_increasing[0]) + 1
        what = (
            f"time must increase from row to row, but {time[row - 1]:.12g} is followed by"
            f" {time[row]:.12g}; sort the rows, and remove those that are there twice"
        )
        raise table.error(what, column, row)


def check_finite(table: MotionTable, values: Array, columns: Sequence[int], fill: bool) -> None:
    """Raise RecordingError for infinite numbers, and for missing ones unless ``fill`` is given."""
    used = values[:, list(columns)]
    wrong = np.isinf(used) if fill else ~np.isfinite(used)
    if wrong.any():
        row, k = (int(part) for part in np.argwhere(wrong)[0])
        missing = "NaN or an empty cell; correct it, or have it interpolated (fill=True, --fill)"
        what = "infinite; correct it" if np.isinf(used[row, k]) else missing
        raise table.error(what, columns[k], row)


def check_limits(
    table: MotionTable, joints: Array, columns: Sequence[int | None], robot: Robot, beyond: float
) -> None:
    """Raise RecordingError where joints (n, nv-6) are past their limits by more than ``beyond``.

    ``columns``: the file's column of each joint; None for one that is not in the file.
    """
    limits = robot.limits
    recorded = np.array([column is not None for column in columns], dtype=bool)
    excess = limits.past(joints)
    wrong = (excess > beyond) & recorded
    if not wrong.any():
        return
    reach = np.fmax(np.abs(limits.lower), np.abs(limits.upper))
    degrees = bool((wrong & (np.abs(joints) > WRONG_UNIT_RATIO * reach)).any())
    row = int(np.flatnonzero(wrong.any(axis=1))[0])
    k = int(np.argmax(np.where(wrong[row], excess[row], -np.inf)))
    worst = 1.001 * float(np.nanmax(np.where(recorded, excess, -np.inf)))  # rounds up
    remedy = (
        "are the angles in degrees? Then say so (degrees), or name the unit: 'knee [deg]'"
        if degrees
        else f"correct it, or allow {worst:.4g} past the limits (beyond)"
    )
    what = (
        f"{joints[row, k]:.6g} is outside the limits [{limits.lower[k]:g}, {limits.upper[k]:g}] of"
        f" joint {robot.joint_names[k]!r}; {remedy}"
    )
    raise table.error(what, columns[k], row)
