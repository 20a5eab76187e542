"""Curves over time: what a history's errors and inertias come to, and how they are drawn."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.spatial import vech_inverse
from wbc.validate import Array
from wbc.view import style

DECADE = 10.0
DEEPEST = 1e-5  # part of the largest error: what is smaller is drawn at the bottom of the axis
SMALLEST = 1e-7  # errors below are of no interest
FEW = 2.0  # per cent of the errors that may be below the axis
LONGEST = 20  # characters of a label
LABEL_GAP = 0.075  # between two labels, part of the plot's height


@dataclass(frozen=True, eq=False)
class Series:
    """A curve: its name, its look and its values over time."""

    label: str
    colour: str
    dashes: str
    values: Array  # (n,)


def error_series(errors: Mapping[str, ArrayLike], count: int) -> list[Series]:
    """Return the norm of each task's error over ``count`` times.

    Raises InvalidInputError: not one row of numbers for each time.
    """
    looks = cycle([(colour, dashes) for dashes in ("-", "--", ":") for colour in style.SERIES])
    rows = {
        name: rows_of(f"errors of {name!r}", values, (count, -1)) for name, values in errors.items()
    }
    return [
        Series(name, *look, np.linalg.norm(values, axis=1))
        for (name, values), look in zip(rows.items(), looks, strict=False)
    ]


def rows_of(what: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return what a history has at each time, of a shape; NaN where there is nothing."""
    try:
        return np.asarray(values, dtype=np.float64).reshape(shape)
    except (TypeError, ValueError) as error:
        what = f"history: {what}: expected numbers, one row for each time"
        raise InvalidInputError(what) from error


def moment_series(inertias: Array) -> list[Series]:
    """Return the principal moments of inertias as vech (n, 6) [kg m^2]."""
    moments = np.linalg.eigvalsh([vech_inverse(one) for one in inertias])  # (n, 3) ascending
    columns = np.asarray(moments, float).T
    return [
        Series(f"about a{style.INDEX[k]}", style.PRINCIPAL[k], "-", columns[k]) for k in range(3)
    ]


def plot_errors(axes: Axes, time: Array, errors: Iterable[Series]) -> None:
    """Draw the norms of the tasks' errors."""
    style.plain(axes, "Task errors", "time [s]", "norm of the error, own unit")
    series = [*errors]
    # Within a decade a logarithmic axis has no round numbers to show.
    finite = [one.values[np.isfinite(one.values)] for one in series]
    seen = np.concatenate([np.zeros(0), *finite])
    largest = float(seen.max(initial=0.0))
    lowest = max(DEEPEST * largest, SMALLEST)
    seen = seen[seen > lowest]
    if len(seen):  # a task that starts at its target does not stretch the axis down to there
        lowest = max(lowest, 0.5 * float(np.percentile(seen, FEW)))
    if largest > 2.0 * DECADE * lowest:
        axes.set_yscale("log")
        axes.set_ylim(lowest, 1.5 * largest)
        series = [replace(one, values=np.maximum(one.values, lowest)) for one in series]
    else:
        axes.set_ylim(0.0, 1.05 * max(largest, SMALLEST))
    plot_curves(axes, time, series)


def plot_moments(axes: Axes, time: Array, moments: Iterable[Series]) -> None:
    """Draw the principal moments of inertia."""
    style.plain(axes, "Principal moments of inertia", "time [s]", "kg m²")
    plot_curves(axes, time, list(moments))


def plot_curves(axes: Axes, time: Array, series: list[Series]) -> None:
    """Draw curves over time, each with its name at its end."""
    marker = "o" if len(time) == 1 else None
    for one in series:
        axes.plot(
            time, one.values, color=one.colour, linestyle=one.dashes, linewidth=1.6, marker=marker
        )
    if len(time) > 1 and time[-1] > time[0]:
        axes.set_xlim(time[0], time[-1])
    _label_ends(axes, [one for one in series if np.isfinite(one.values).any()])


def _label_ends(axes: Axes, series: list[Series]) -> None:
    """Write each curve's name at its end, moved up or down where two would overlap."""
    axes.autoscale_view()  # or else the limits are found only when the figure is written
    last = [(0.0, one.values[np.isfinite(one.values)][-1]) for one in series]
    to_axes = axes.transData + axes.transAxes.inverted()
    heights = to_axes.transform(np.reshape(last, (-1, 2)))[:, 1]
    for one, height in zip(series, spread(heights, LABEL_GAP), strict=True):
        axes.text(
            1.02, height, shortened(one.label), color=one.colour, fontsize=style.SMALL,
            va="center", transform=axes.transAxes,
        )  # fmt: skip


def shortened(label: str, longest: int = LONGEST) -> str:
    """Return a label of at most ``longest`` characters, without endings that say nothing.

    The middle gives way: rows of one contact differ in their ends.
    """
    for ending in ("_link", "_joint"):
        label = label.replace(ending, "")
    half = longest // 2
    return label if len(label) <= longest else f"{label[:half]}…{label[half + 1 - longest :]}"


def spread(heights: Array, gap: float) -> Array:
    """Return heights (k,) at least ``gap`` apart, in the same order, none above 1 if they fit."""
    order = np.argsort(heights)
    placed = heights[order]
    for k in range(1, len(placed)):
        placed[k] = max(placed[k], placed[k - 1] + gap)
    ceiling = 1.0
    for k in reversed(range(len(placed))):
        placed[k] = min(placed[k], ceiling)
        ceiling = placed[k] - gap
    result = np.empty_like(placed)
    result[order] = placed
    return result
