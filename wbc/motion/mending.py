"""Dropouts found, reported, and filled as far as that was declared."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from wbc.motion.dropouts import (
    FROZEN,
    GAP,
    MISSING,
    Dropout,
    frozen_runs,
    interpolated,
    missing_runs,
    time_gaps,
    with_rows_in_gaps,
)
from wbc.motion.table import Table
from wbc.robot import Robot
from wbc.validate import Array

SLACK = 1e-9  # s: a gap that is the longest allowed but for rounding


def mended(
    table: Table,
    time: Array,
    content: Array,
    names: tuple[str, ...],
    where: Mapping[str, int],
    robot: Robot,
    fill: bool,
    longest: float,
) -> tuple[Array, Array, tuple[Dropout, ...]]:
    """Return times, content without NaN, and what was missing.

    Parameters
    ----------
    time, content:
        Times (n,) [s]; joints and, if recorded, base (n, k) with NaN where numbers are missing.
    names:
        Names of the content's columns.
    where:
        Their columns in the table, and that of ``time``, as far as it has them.
    fill:
        Fill missing numbers and frozen rows; gaps in time are always filled.
    longest:
        Longest time to interpolate over [s].

    Raises
    ------
    RecordingError
        Something to be filled lasts longer, or is at the recording's begin or end.
    """
    count = len(robot.joint_names)
    content = content.copy()
    dropouts = []
    for row, end, columns in _missing(content, names):
        _check(table, where, time, (row, end), columns, longest)
        dropouts.append(Dropout(MISSING, float(time[row]), float(time[end]), columns, True))
    for first, last, moved in frozen_runs(time, content[:, :count]):
        columns = tuple(name for name, one in zip(names, moved, strict=False) if one)
        end = last + 1
        if fill:
            _check(table, where, time, (first, end), columns, longest)
            # The base is recorded apart, and may go on where the joints are frozen.
            still = (content[first:end] == content[first]).all(axis=0)
            content[first + 1 : end, still] = np.nan
        dropouts.append(Dropout(FROZEN, float(time[first]), float(time[end]), columns, fill))
    gaps = time_gaps(time)
    for before, after in gaps:
        _check(table, where, time, (before, after), ("time",), longest)
        dropouts.append(Dropout(GAP, float(time[before]), float(time[after]), ("all",), True))
    _join_turns(content, names, robot)
    time, content = with_rows_in_gaps(time, content, gaps)
    content = interpolated(time, content)
    return time, content, tuple(sorted(dropouts, key=lambda one: one.start))


def _missing(content: Array, names: Sequence[str]) -> list[tuple[int, int, tuple[str, ...]]]:
    """Return runs of missing numbers, those of several columns that are at once as one."""
    found: dict[tuple[int, int], list[str]] = {}
    for column, before, after in missing_runs(content):
        found.setdefault((before, after), []).append(names[column])
    return [(before, after, tuple(columns)) for (before, after), columns in found.items()]


def _check(
    table: Table,
    where: Mapping[str, int],
    time: Array,
    between: tuple[int, int],
    columns: tuple[str, ...],
    longest: float,
) -> None:
    """Raise RecordingError unless the rows between two good ones may be interpolated."""
    before, after = between
    column = next((where[name] for name in columns if name in where), None)
    if before < 0 or after >= len(time):
        what = "numbers are missing at the begin or end, where there is nothing to interpolate"
        raise table.error(f"{what} ({', '.join(columns)}); cut these rows off", column, before + 1)
    duration = float(time[after] - time[before])
    if duration > longest + SLACK:
        what = (
            f"nothing usable from {time[before]:.12g} s to {time[after]:.12g} s, {duration:.3g} s;"
            f" only up to {longest:g} s is interpolated: declare a longest gap of"
            f" {_rounded_up(duration):g} s, or cut the recording there"
        )
        raise table.error(what, column, after)


def _rounded_up(seconds: float) -> float:
    """Return a duration rounded up to two digits, so that it can be declared as it is told."""
    unit = 10.0 ** (math.floor(math.log10(seconds)) - 1)
    return unit * math.ceil(seconds / unit - SLACK)


def _join_turns(content: Array, names: Sequence[str], robot: Robot) -> None:
    """Undo in place the jumps of continuous joints (by 2 pi), and of quaternions (by sign)."""
    for k in robot.limits.unbounded:
        known = np.flatnonzero(np.isfinite(content[:, k]))
        content[known, k] = np.unwrap(content[known, k])
    if len(names) > len(robot.joint_names):
        start = len(robot.joint_names) + 3
        whole = np.isfinite(content[:, start:]).all(axis=1)
        content[~whole, start:] = np.nan
        known = np.flatnonzero(whole)
        content[known, start:] = same_sign(content[known, start:])


def same_sign(quaternions: Array) -> Array:
    """Return quaternions (n, 4), each with the sign nearest to the one before."""
    flips = (quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0.0
    signs = np.concatenate(([1.0], np.cumprod(np.where(flips, -1.0, 1.0))))
    return np.asarray(quaternions * signs[:, None])
