"""Checks on recorded numbers; each names the file, the column and the row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wbc.motion.table import Table
from wbc.robot import Robot
from wbc.validate import Array

TENFOLD = 10.0  # so far past its limits that a joint must be in another unit


def check_times(table: Table, time: Array, column: int) -> None:
    """Raise RecordingError if times (n,) are not finite or do not increase."""
    unknown = np.flatnonzero(~np.isfinite(time))
    if len(unknown):
        raise table.error("there is no time here; remove the row", column, int(unknown[0]))
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if len(back):
        row = int(back[0]) + 1
        what = (
            f"time must increase from row to row, but {time[row - 1]:.12g} is followed by"
            f" {time[row]:.12g}; sort the rows, and remove those that are there twice"
        )
        raise table.error(what, column, row)


def check_finite(table: Table, values: Array, columns: Sequence[int], fill: bool) -> None:
    """Raise RecordingError for infinite numbers, and for missing ones unless ``fill`` is given."""
    used = values[:, list(columns)]
    wrong = np.isinf(used) if fill else ~np.isfinite(used)
    if wrong.any():
        row, k = (int(part) for part in np.argwhere(wrong)[0])
        infinite = np.isinf(used[row, k])
        remedy = "correct it" if infinite else "correct it, or have it interpolated (fill)"
        what = f"{'infinite' if infinite else 'NaN or an empty cell'}; {remedy}"
        raise table.error(what, columns[k], row)


def check_limits(
    table: Table, joints: Array, columns: Sequence[int | None], robot: Robot, beyond: float
) -> None:
    """Raise RecordingError where joints (n, nv-6) are past their limits by more than ``beyond``.

    Parameters
    ----------
    columns:
        The file's column of each joint; None for one that is not in the file.
    """
    limits = robot.limits
    recorded = np.array([column is not None for column in columns], dtype=bool)
    excess = np.fmax(limits.lower - joints, joints - limits.upper)  # NaN compares as inside
    wrong = (excess > beyond) & recorded
    if not wrong.any():
        return
    reach = np.fmax(np.abs(limits.lower), np.abs(limits.upper))
    degrees = bool((wrong & (np.abs(joints) > TENFOLD * reach)).any())
    row = int(np.flatnonzero(wrong.any(axis=1))[0])
    k = int(np.argmax(np.where(wrong[row], excess[row], -np.inf)))
    worst = 1.001 * float(np.nanmax(np.where(recorded, excess, -np.inf)))  # rounds up
    remedy = (
        "are the angles in degrees? Then declare that (degrees), or name the unit: 'knee [deg]'"
        if degrees
        else f"correct it, or allow joints to be {worst:.4g} past them (beyond)"
    )
    what = (
        f"{joints[row, k]:.6g} is outside the limits [{limits.lower[k]:g}, {limits.upper[k]:g}] of"
        f" joint {robot.joint_names[k]!r}; {remedy}"
    )
    raise table.error(what, columns[k], row)
