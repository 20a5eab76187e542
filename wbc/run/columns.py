"""A run as a table: a row per tick, columns with names and units; as a data frame, in a file."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from wbc.extras import require
from wbc.files import write_whole
from wbc.robot import Robot
from wbc.robot.series import turning_joints
from wbc.run.history import History
from wbc.spatial import COMPONENTS
from wbc.validate import Array

Column = tuple[str, Array]  # header, (n,)
XYZ = ("x", "y", "z")
BASE = ("x [m]", "y [m]", "z [m]", "qx [1]", "qy [1]", "qz [1]", "qw [1]")
BASE_RATES = ("vx [m/s]", "vy [m/s]", "vz [m/s]", "wx [rad/s]", "wy [rad/s]", "wz [rad/s]")


def history_columns(
    robot: Robot, history: History, rows: Mapping[str, Sequence[str]]
) -> list[Column]:
    """Return the columns of a run, each with its header such as ``left_knee [rad]``.

    Time and configuration come first, under the names that :func:`wbc.read_motion` knows; the names
    of all others have a slash, so that ``ignore="*/*"`` passes over them. Words are left out:
    phases, supports and the nearest rows are in an ``.npz`` only.

    Parameters
    ----------
    rows:
        Names of the entries of each task's error, with units, by task.
    """
    return [
        ("time [s]", history.time),
        *placed_columns(robot, history.q),
        *rate_columns(robot, history.v),
        *_measured(history, rows),
    ]


def placed_columns(robot: Robot, q: Array) -> Iterator[Column]:
    """Yield the columns of configurations (n, nq)."""
    for k, name in enumerate(BASE):
        yield f"base_{name}", q[:, k]
    joints = robot.limits.joint_positions(q)
    for k, (name, turns) in enumerate(zip(robot.joint_names, turning_joints(robot), strict=True)):
        yield f"{name} [{'rad' if turns else 'm'}]", joints[:, k]


def rate_columns(robot: Robot, v: Array) -> Iterator[Column]:
    """Yield the columns of velocities (n, nv)."""
    for k, name in enumerate(BASE_RATES):
        yield f"velocity/base_{name}", v[:, k]
    for k, (name, turns) in enumerate(zip(robot.joint_names, turning_joints(robot), strict=True)):
        yield f"velocity/{name} [{'rad/s' if turns else 'm/s'}]", v[:, 6 + k]


def _measured(history: History, rows: Mapping[str, Sequence[str]]) -> Iterator[Column]:
    for k, axis in enumerate(XYZ):
        yield f"com/{axis} [m]", history.com[:, k]
    for k, entry in enumerate(COMPONENTS):
        yield f"inertia/{entry} [kg m^2]", history.inertia[:, k]
    for name, errors in history.errors.items():
        for k, row in enumerate(rows[name]):
            yield f"error/{name}/{row}", errors[:, k]
    for name, places in history.targets.items():
        for k, axis in enumerate(XYZ):
            yield f"target/{name}/{axis} [m]", places[:, k]
    yield "limits/least_left [rad or m]", history.margin
    if np.isfinite(history.balance).any():
        yield "balance/com_inside_soles [m]", history.balance
    for name, left in history.clearance.items():
        yield f"constraint/{name} [m]", left
    for label, on in history.active.items():
        yield f"held_back/{label} [1]", on.astype(float)
    yield "tick/time [s]", history.tick_time
    yield "tick/kkt_residual [1]", history.kkt


Frame: TypeAlias = Any  # a pandas.DataFrame
SUMMARY = "wbc.summary"  # the key of the file's metadata under which its JSON text is


def frame_of(columns: Sequence[Column]) -> Frame:
    """Return columns as a data frame, a row per tick, heads with units.

    Raises
    ------
    MissingPackageError
        pandas is not installed.
    """
    require("pandas", "result.to_frame()")
    import pandas

    return pandas.DataFrame(dict(columns))


def write_parquet(path: str | Path, columns: Sequence[Column], summary: str) -> None:
    """Write columns into a Parquet file, whole or not at all, with a summary's JSON text.

    Raises
    ------
    MissingPackageError
        pyarrow is not installed.
    OSError
        The file cannot be written.
    """
    require("pyarrow", "a result as .parquet")
    import pyarrow
    from pyarrow import parquet

    table: Any = pyarrow.table(dict(columns)).replace_schema_metadata({SUMMARY: summary})
    packed = io.BytesIO()
    parquet.write_table(table, packed)
    write_whole(path, lambda file: file.write(packed.getbuffer()))
