"""What a recording lacks: gaps in time, numbers that are missing, rows that repeat."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from wbc.motion.smoothing import check_count
from wbc.validate import Array

GAP, MISSING, FROZEN = "gap in time", "missing numbers", "frozen"
# Steps longer than this many median steps are gaps: one lost row makes two.
LOST = 1.75
# Rows are frozen if some joint, at the speed it has on both sides, should meanwhile have moved by
# this much [rad or m], and by so many of the smallest steps it is recorded in.
UNMOVED, QUANTA = 1e-3, 3.0
AROUND = 5  # steps on each side that the speed is taken from
LISTED = 4


@dataclass(frozen=True)
class Dropout:
    """Something that a recording lacks.

    Attributes
    ----------
    kind:
        ``gap in time``, ``missing numbers`` or ``frozen``.
    start, end:
        Times of the last good row before and the first one after [s].
    columns:
        What is concerned: joints and base columns.
    filled:
        True if it was interpolated over; else the rows are as recorded.
    """

    kind: str
    start: float
    end: float
    columns: tuple[str, ...]
    filled: bool

    @property
    def duration(self) -> float:
        """From the last good row to the next [s]."""
        return self.end - self.start

    def __str__(self) -> str:
        names = ", ".join(self.columns[:LISTED])
        more = f" and {len(self.columns) - LISTED} more" if len(self.columns) > LISTED else ""
        what = f"{self.kind} from {self.start:.12g} s to {self.end:.12g} s"
        done = "interpolated" if self.filled else "left as recorded"
        return f"{what}: {names}{more}; {done}"


def time_gaps(time: Array) -> list[tuple[int, int]]:
    """Return pairs of neighbouring rows between which rows were lost."""
    steps = np.diff(time)
    if not len(steps):
        return []
    rows = np.flatnonzero(steps > LOST * np.median(steps)).tolist()
    return [(k, k + 1) for k in rows]


def missing_runs(values: Array) -> Iterator[tuple[int, int, int]]:
    """Yield column, and the good rows before and after, of each run of NaN in (n, k).

    The row before is -1, or the row after n, where a run is not enclosed.
    """
    holes = np.isnan(values)
    for column in np.flatnonzero(holes.any(axis=0)).tolist():
        for first, end in runs(holes[:, column]):
            yield column, first - 1, end


def runs(marked: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return begin and end (exclusive) of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], marked, [False])).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def frozen_runs(time: Array, joints: Array) -> Iterator[tuple[int, int, NDArray[np.bool_]]]:
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


def with_rows_in_gaps(
    time: Array, values: Array, gaps: Sequence[tuple[int, int]]
) -> tuple[Array, Array]:
    """Return times and values with rows of NaN where rows were lost, a median step apart.

    Raises
    ------
    InvalidInputError
        More rows than can be handled.
    """
    if not gaps:
        return time, values
    step = float(np.median(np.diff(time)))
    check_count("gaps to fill", sum(time[after] - time[before] for before, after in gaps), step)
    where, inserted = list[int](), list[float]()
    for before, after in gaps:
        count = max(2, round((time[after] - time[before]) / step))
        inserted += np.linspace(time[before], time[after], count + 1)[1:-1].tolist()
        where += [after] * (count - 1)
    return np.insert(time, where, inserted), np.insert(values, where, np.nan, axis=0)


def interpolated(time: Array, values: Array) -> Array:
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
