"""Dropouts: gaps in time, missing numbers and frozen rows; found, reported and interpolated."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from wbc.errors import InvalidInputError, listed
from wbc.motion.columns import PLACE
from wbc.motion.table import MotionTable
from wbc.robot import Robot
from wbc.rotations import same_sign
from wbc.validate import Array

GAP, MISSING, FROZEN = "gap in time", "missing numbers", "frozen"
# Steps longer than this many median steps are gaps: one lost row makes two.
LOST = 1.75
# Rows are frozen if some joint, at the speed it has on both sides, should meanwhile have moved by
# this much [rad or m], and by so many of the smallest steps it is recorded in.
UNMOVED, QUANTA = 1e-3, 3.0
AROUND = 5  # steps on each side that the speed is taken from
LISTED = 4
SLACK = 1e-9  # s: a gap that is the longest allowed but for rounding
MOST_FRAMES = 1_000_000  # with 3 kB or so each


@dataclass(frozen=True)
class Dropout:
    """Something that a recording lacks."""

    kind: str  # gap in time, missing numbers or frozen
    # start and end: times of the last good row before and the first one after [s].
    start: float
    end: float
    columns: tuple[str, ...]  # what is concerned: joints and base columns
    filled: bool  # true if it was interpolated over; else the rows are as recorded

    @property
    def duration(self) -> float:
        """From the last good row to the next [s]."""
        return self.end - self.start

    def __str__(self) -> str:
        what = f"{self.kind} from {self.start:.12g} s to {self.end:.12g} s"
        done = "interpolated" if self.filled else "left as recorded"
        return f"{what}: {listed(self.columns, LISTED)}; {done}"


def fill_gaps(
    table: MotionTable,
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
    dropouts = list[Dropout]()

    def note(kind: str, rows: tuple[int, int], columns: tuple[str, ...], filled: bool) -> None:
        """Note the gap between two good rows; raise an error if it is too long to be filled."""
        before, after = rows
        column = next((where[name] for name in columns if name in where), None)
        if before < 0 or after >= len(time):
            what = "numbers are missing at the begin or end, where there is nothing to interpolate"
            what = f"{what} ({', '.join(columns)}); cut these rows off"
            raise table.error(what, column, before + 1)
        dropout = Dropout(kind, float(time[before]), float(time[after]), columns, filled)
        if filled and dropout.duration > longest + SLACK:
            what = (
                f"nothing usable from {dropout.start:.12g} s to {dropout.end:.12g} s,"
                f" {dropout.duration:.3g} s; only up to {longest:g} s is interpolated: declare a"
                f" longest gap of {_rounded_up(dropout.duration):g} s, or cut the recording there"
            )
            raise table.error(what, column, after)
        dropouts.append(dropout)

    for rows, columns in _missing_runs(content, names).items():
        note(MISSING, rows, columns, True)
    for first, last, moved in _frozen_runs(time, content[:, :count]):
        columns = tuple(name for name, one in zip(names, moved, strict=False) if one)
        end = last + 1
        note(FROZEN, (first, end), columns, fill)
        if fill:
            # The base is recorded apart, and may go on where the joints are frozen.
            still = (content[first:end] == content[first]).all(axis=0)
            content[first + 1 : end, still] = np.nan
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > LOST * np.median(steps)).tolist() if len(steps) else []
    for row in gaps:
        note(GAP, (row, row + 1), ("all",), True)
    unwrap(robot, content[:, :count], content[:, count + len(PLACE) :])
    time, content = _with_rows_in_gaps(time, content, gaps)
    return time, _interpolated(time, content), tuple(sorted(dropouts, key=lambda one: one.start))


def _rounded_up(seconds: float) -> float:
    """Return a duration rounded up to two digits, so that it can be declared as it is told."""
    unit = 10.0 ** (math.floor(math.log10(seconds)) - 1)
    return unit * math.ceil(seconds / unit - SLACK)


def unwrap(robot: Robot, joints: Array, quaternions: Array) -> None:
    """Undo in place the jumps of continuous joints (by 2 pi), and of quaternions (by sign).

    Parameters
    ----------
    joints:
        (n, nv-6) [rad or m], with NaN where numbers are missing.
    quaternions:
        (n, 4), likewise, or (n, 0) without a base.
    """
    for k in robot.limits.unbounded:
        known = np.isfinite(joints[:, k])
        joints[known, k] = np.unwrap(joints[known, k])
    if quaternions.size:
        whole = np.isfinite(quaternions).all(axis=1)
        quaternions[~whole] = np.nan
        quaternions[whole] = same_sign(quaternions[whole])


def _missing_runs(content: Array, names: Sequence[str]) -> dict[tuple[int, int], tuple[str, ...]]:
    """Return columns by the good rows before and after each run of NaN in (n, k) that they share.

    The row before is -1, or the row after n, where a run is not enclosed.
    """
    found: dict[tuple[int, int], tuple[str, ...]] = {}
    holes = np.isnan(content)
    for column in np.flatnonzero(holes.any(axis=0)).tolist():
        for first, end in runs(holes[:, column]):
            found[first - 1, end] = (*found.get((first - 1, end), ()), names[column])
    return found


def runs(marked: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return begin and end (exclusive) of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], marked, [False])).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _frozen_runs(time: Array, joints: Array) -> Iterator[tuple[int, int, NDArray[np.bool_]]]:
    """Yield the first and last row of each frozen run, and which joints (k,) should have moved.

    Rows repeat exactly, in all joints, while the robot moves before and after. A robot at rest, or
    slow for how finely it is recorded, is not frozen. NaN never repeats.
    """
    if len(time) < 3 or joints.shape[1] == 0:
        return
    steps = np.abs(np.diff(joints, axis=0))
    quantum = np.where(steps > 0.0, steps, np.inf).min(axis=0)  # (k,)
    least = np.maximum(UNMOVED, QUANTA * np.where(np.isfinite(quantum), quantum, 0.0))
    for first, last in runs((steps == 0.0).all(axis=1)):
        before, after = max(first - AROUND, 0), min(last + AROUND, len(time) - 1)
        if before == first or after == last:
            continue
        speed = np.minimum(
            np.abs(joints[first] - joints[before]) / (time[first] - time[before]),
            np.abs(joints[after] - joints[last]) / (time[after] - time[last]),
        )
        expected = speed * (time[last] - time[first])
        moved = expected > least
        if moved.any():
            yield first, last, moved


def _with_rows_in_gaps(time: Array, values: Array, gaps: Sequence[int]) -> tuple[Array, Array]:
    """Return times and values with rows of NaN after rows ``gaps``, a median step apart.

    Raises
    ------
    InvalidInputError
        More rows than can be handled.
    """
    if not gaps:
        return time, values
    steps = np.diff(time)
    step = float(np.median(steps))
    check_count("gaps to fill", float(steps[gaps].sum()), step)
    where, inserted = list[int](), list[float]()
    for row in gaps:
        count = max(2, round(float(steps[row]) / step))
        inserted += np.linspace(time[row], time[row + 1], count + 1)[1:-1].tolist()
        where += [row + 1] * (count - 1)
    return np.insert(time, where, inserted), np.insert(values, where, np.nan, axis=0)


def _interpolated(time: Array, values: Array) -> Array:
    """Return values (n, k) with NaN filled in from the rows around, without overshoot (PCHIP).

    Each column must hold a number in its first and last row.
    """
    filled = values.copy()
    holes = np.isnan(values)
    for column in np.flatnonzero(holes.any(axis=0)).tolist():
        hole = holes[:, column]
        curve = PchipInterpolator(time[~hole], values[~hole, column])
        filled[hole, column] = curve(time[hole])
    return filled


def check_count(what: str, seconds: float, step: float) -> None:
    """Raise InvalidInputError if a time holds more steps than can be handled."""
    if seconds > MOST_FRAMES * step:
        raise InvalidInputError(
            f"{what}: {seconds:.4g} s would be {seconds / step:.3g} frames; at most"
            f" {MOST_FRAMES:,} are possible"
        )
