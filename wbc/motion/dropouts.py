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
GAP_RATIO = 1.75  # of a gap to the median step: one lost row makes two
# Rows are frozen if some joint, at the speed before and after them, should have moved by more than
# this [rad or m], and by more than so many quanta of its recording.
MIN_EXPECTED_MOTION, MIN_QUANTA = 1e-3, 3.0
SPEED_STEPS = 5  # on each side, over which the speed is taken
LISTED = 4
TIME_TOLERANCE = 1e-9  # s, of rounding
MAX_FRAMES = 1_000_000  # with 3 kB or so each


@dataclass(frozen=True)
class Dropout:
    """Missing or frozen data of a recording."""

    kind: str  # gap in time, missing numbers or frozen
    # start and end: times of the last good row before and the first one after [s].
    start: float
    end: float
    columns: tuple[str, ...]  # joints and base columns that are affected
    filled: bool  # True if interpolated; else the rows are as recorded

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
    """Return times, content without NaN, and the dropouts.

    ``time``, ``content``: times (n,) [s]; joints and, if recorded, base (n, k) with NaN where
    numbers are missing.
    ``names``: names of the content's columns.
    ``where``: their columns in the table, and that of ``time``, as far as it has them.
    ``fill``: fill missing numbers and frozen rows; gaps in time are always filled.
    ``longest``: longest gap that is interpolated [s].

    Raises RecordingError: a gap to be filled is longer, or at the recording's beginning or end.
    """
    count = len(robot.joint_names)
    content = content.copy()
    dropouts = list[Dropout]()

    def note(kind: str, rows: tuple[int, int], columns: tuple[str, ...], filled: bool) -> None:
        """Append the gap between two good rows; raise an error if it is too long to be filled."""
        before, after = rows
        column = next((where[name] for name in columns if name in where), None)
        if before < 0 or after >= len(time):
            what = "numbers are missing at the beginning or end, where they cannot be interpolated"
            what = f"{what} ({', '.join(columns)}); cut these rows off"
            raise table.error(what, column, before + 1)
        dropout = Dropout(kind, float(time[before]), float(time[after]), columns, filled)
        if filled and dropout.duration > longest + TIME_TOLERANCE:
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
            # The base is recorded separately, and may move while the joints are frozen.
            frozen = (content[first:end] == content[first]).all(axis=0)
            content[first + 1 : end, frozen] = np.nan
    gaps = missing_frames(time)
    for row in gaps:
        note(GAP, (row, row + 1), ("all",), True)
    unwrap(robot, content[:, :count], content[:, count + len(PLACE) :])
    time, content = insert_rows(time, content, gaps)
    return time, _interpolate(time, content), tuple(sorted(dropouts, key=lambda one: one.start))


def _rounded_up(seconds: float) -> float:
    """Return a duration rounded up to two digits, so that the printed value is allowed."""
    unit = 10.0 ** (math.floor(math.log10(seconds)) - 1)
    return unit * math.ceil(seconds / unit - TIME_TOLERANCE)


def unwrap(robot: Robot, joints: Array, quaternions: Array) -> None:
    """Undo in place the jumps of continuous joints (by 2 pi), and of quaternions (by sign).

    ``joints``: (n, nv-6) [rad or m], with NaN where numbers are missing; ``quaternions``: (n, 4),
    likewise, or (n, 0) without a base.
    """
    for k in robot.limits.unbounded:
        known = np.isfinite(joints[:, k])
        joints[known, k] = np.unwrap(joints[known, k])
    if quaternions.size:
        complete = np.isfinite(quaternions).all(axis=1)
        quaternions[~complete] = np.nan
        quaternions[complete] = same_sign(quaternions[complete])


def _missing_runs(content: Array, names: Sequence[str]) -> dict[tuple[int, int], tuple[str, ...]]:
    """Return the columns of each run of NaN in (n, k), by the good rows before and after it.

    The row before is -1, or the row after n, at the beginning or end.
    """
    found: dict[tuple[int, int], tuple[str, ...]] = {}
    holes = np.isnan(content)
    for column in np.flatnonzero(holes.any(axis=0)).tolist():
        for first, end in runs(holes[:, column]):
            found[first - 1, end] = (*found.get((first - 1, end), ()), names[column])
    return found


def runs(marked: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the start and end (exclusive) of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], marked, [False])).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _frozen_runs(time: Array, joints: Array) -> Iterator[tuple[int, int, NDArray[np.bool_]]]:
    """Yield the first and last row of each frozen run, and which joints (k,) should have moved.

    Frozen rows repeat exactly, in all joints, while the robot moves before and after. A robot at
    rest, or slow by the quantum of its recording, is not frozen. NaN never repeats.
    """
    if len(time) < 3 or joints.shape[1] == 0:
        return
    steps = np.abs(np.diff(joints, axis=0))
    quantum = np.where(steps > 0.0, steps, np.inf).min(axis=0)  # (k,)
    least = np.maximum(
        MIN_EXPECTED_MOTION, MIN_QUANTA * np.where(np.isfinite(quantum), quantum, 0.0)
    )
    for first, last in runs((steps == 0.0).all(axis=1)):
        before, after = max(first - SPEED_STEPS, 0), min(last + SPEED_STEPS, len(time) - 1)
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


def missing_frames(time: Array) -> list[int]:
    """Return the rows after which frames are missing, by the median step of times (n,)."""
    steps = np.diff(time)
    return np.flatnonzero(steps > GAP_RATIO * np.median(steps)).tolist() if len(steps) else []


def insert_rows(time: Array, values: Array, gaps: Sequence[int]) -> tuple[Array, Array]:
    """Return times and values with rows of NaN after rows ``gaps``, a median step apart.

    Raises InvalidInputError: more rows than can be handled.
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


def _interpolate(time: Array, values: Array) -> Array:
    """Return values (n, k) with NaN interpolated, without overshoot (PCHIP).

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
    """Raise InvalidInputError if a duration has more steps than can be handled."""
    if seconds > MAX_FRAMES * step:
        raise InvalidInputError(
            f"{what}: {seconds:.4g} s would be {seconds / step:.3g} frames; at most"
            f" {MAX_FRAMES:,} are possible"
        )
