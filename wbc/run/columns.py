"""A run as a table, a row per tick, columns with names and units: a data frame or a file."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from wbc.extras import require
from wbc.files import write_whole
from wbc.robot import Robot
from wbc.robot.series import revolute_joints
from wbc.run.history import History
from wbc.spatial import COMPONENTS
from wbc.validate import Array

Column = tuple[str, Array]  # header, (n,)
XYZ = ("x", "y", "z")
BASE_POSE = ("x [m]", "y [m]", "z [m]", "qx [1]", "qy [1]", "qz [1]", "qw [1]")
BASE_TWIST = ("vx [m/s]", "vy [m/s]", "vz [m/s]", "wx [rad/s]", "wy [rad/s]", "wz [rad/s]")


def history_columns(
    robot: Robot, history: History, rows: Mapping[str, Sequence[str]]
) -> list[Column]:
    """Return the columns of a run, each with its header such as ``left_knee [rad]``.

    Time and configuration come first, under the names that :func:`wbc.read_motion` knows; the names
    of all others have a slash, so that ``ignore="*/*"`` skips them. Text is omitted: phases,
    supports and the nearest rows are in an ``.npz`` only.

    ``rows``: names of the entries of each task's error, with units, by task.
    """
    return [
        ("time [s]", history.time),
        *configuration_columns(robot, history.q),
        *velocity_columns(robot, history.v),
        *_recorded_columns(history, rows),
    ]


def configuration_columns(robot: Robot, q: Array) -> Iterator[Column]:
    """Yield the columns of configurations (n, nq)."""
    for k, name in enumerate(BASE_POSE):
        yield f"base_{name}", q[:, k]
    joints = robot.limits.joint_positions(q)
    for k, (name, turns) in enumerate(zip(robot.joint_names, revolute_joints(robot), strict=True)):
        yield f"{name} [{'rad' if turns else 'm'}]", joints[:, k]


def velocity_columns(robot: Robot, v: Array) -> Iterator[Column]:
    """Yield the columns of velocities (n, nv)."""
    for k, name in enumerate(BASE_TWIST):
        yield f"velocity/base_{name}", v[:, k]
    for k, (name, turns) in enumerate(zip(robot.joint_names, revolute_joints(robot), strict=True)):
        yield f"velocity/{name} [{'rad/s' if turns else 'm/s'}]", v[:, 6 + k]


def _recorded_columns(history: History, rows: Mapping[str, Sequence[str]]) -> Iterator[Column]:
    for k, axis in enumerate(XYZ):
        yield f"com/{axis} [m]", history.com[:, k]
    for k, entry in enumerate(COMPONENTS):
        yield f"inertia/{entry} [kg m^2]", history.inertia[:, k]
    for name, errors in history.errors.items():
        for k, row in enumerate(rows[name]):
            yield f"error/{name}/{row}", errors[:, k]
    for name, points in history.targets.items():
        for k, axis in enumerate(XYZ):
            yield f"target/{name}/{axis} [m]", points[:, k]
    yield "limits/least_left [rad or m]", history.margin
    if np.isfinite(history.balance).any():
        yield "balance/com_inside_soles [m]", history.balance
    for name, clearance in history.clearance.items():
        unit = next(filter(None, history.clearance_unit.get(name, ())), "m")
        yield f"constraint/{name} [{unit}]", clearance
    for label, active in history.active.items():
        yield f"held_back/{label} [1]", active.astype(float)
    yield "tick/time [s]", history.tick_time
    yield "tick/kkt_residual [1]", history.kkt


Frame: TypeAlias = Any  # a pandas.DataFrame
SUMMARY = "wbc.summary"  # key of the JSON text in the file's metadata


def frame_of(columns: Sequence[Column]) -> Frame:
    """Return columns as a data frame, a row per tick, headers with units.

    Raises MissingPackageError: pandas is not installed.
    """
    require("pandas", "result.to_frame()")
    import pandas

    return pandas.DataFrame(dict(columns))


def write_parquet(path: str | Path, columns: Sequence[Column], summary: str) -> None:
    """Write columns and a summary's JSON text into a Parquet file, atomically.

    Raises MissingPackageError: pyarrow is not installed; OSError: the file cannot be written.
    """
    require("pyarrow", "a result as .parquet")
    import pyarrow
    from pyarrow import parquet

    table: Any = pyarrow.table(dict(columns)).replace_schema_metadata({SUMMARY: summary})
    buffer = io.BytesIO()
    parquet.write_table(table, buffer)
    write_whole(path, lambda file: file.write(buffer.getbuffer()))
