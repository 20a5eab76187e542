"""A run of a controller in one figure: the robot before and after, and the errors in between."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.spatial import matrix, strung
from wbc.validate import Array, finite_array
from wbc.view import style
from wbc.view.files import picture_file, save
from wbc.view.portrait import draw_portraits, portraits_of, shape_of

WIDTH = 9.0  # inches
PANEL_SHAPE = (0.55, 0.95)  # height to width, at least and at most
HEADING, BETWEEN, PLOT, BELOW = 0.65, 0.85, 2.1, 0.5  # inches, from the top
LEFT, PLOT_WIDTH = 0.75, 2.6  # inches, of each plot; the labels of its curves take the rest
DECADE = 10.0
SMALLEST = 1e-12  # errors below are drawn as this: they are zero but for rounding
LONGEST = 20  # characters of a label
LABEL_GAP = 0.075  # between two labels, part of the plot's height


class History(Protocol):
    """What a run leaves behind; an attribute ``inertia`` (n, 6) is used if there is one.

    Attributes
    ----------
    time:
        (n,) [s].
    q:
        Configurations (n, nq).
    errors:
        Error of each task, (n, k) or (n,).
    """

    @property
    def time(self) -> ArrayLike: ...
    @property
    def q(self) -> ArrayLike: ...
    @property
    def errors(self) -> Mapping[str, ArrayLike]: ...


@dataclass(frozen=True, eq=False)
class _Series:
    label: str
    colour: str
    dashes: str
    values: Array  # (n,)


def plot_run(robot: Robot, history: History, path: str | Path, *, title: str) -> Path:
    """Draw a run: the robot before and after, its tasks' errors and its principal moments.

    Parameters
    ----------
    history:
        The run. Its ``inertia`` (n, 6), entries xx xy xz yy yz zz [kg m^2], is computed from ``q``
        if it has none. Errors may be NaN where a task was not active.
    path:
        The file: png, svg or pdf by its suffix.

    Returns
    -------
    The file.

    Raises
    ------
    InvalidInputError
        Another suffix, no such folder, an empty history or one whose arrays do not fit together.
    ModelError
        The robot's meshes cannot be read.
    """
    path = picture_file(path)
    save(run_figure(robot, history, title=title), path)
    return path


def run_figure(robot: Robot, history: History, *, title: str) -> Figure:
    """Return the figure that :func:`plot_run` writes."""
    time, q = _times_and_configurations(robot, history)
    errors = _error_series(history.errors, len(time))
    moments = _moment_series(_inertias(robot, history, q))
    ends = {f"before, t = {time[0]:g} s": q[0], f"after, t = {time[-1]:g} s": q[-1]}
    portraits = portraits_of(robot, ends)
    high = 0.5 * WIDTH * float(np.clip(shape_of(portraits), *PANEL_SHAPE))
    total = HEADING + high + BETWEEN + PLOT + BELOW
    figure = Figure(figsize=(WIDTH, total), dpi=style.DPI, facecolor="white")
    style.heading(figure, title, 1.0 - 0.12 / total)
    bottom = (BELOW + PLOT + BETWEEN) / total
    panels = [figure.add_axes((0.5 * k, bottom, 0.5, high / total)) for k in range(2)]
    draw_portraits(panels, portraits)
    left, right = (
        figure.add_axes((0.5 * k + LEFT / WIDTH, BELOW / total, PLOT_WIDTH / WIDTH, PLOT / total))
        for k in range(2)
    )
    _plot_errors(left, time, errors)
    _plot_moments(right, time, moments)
    return figure


# ---------------------------------------------------------------------- reading the history


def _times_and_configurations(robot: Robot, history: History) -> tuple[Array, Array]:
    count = np.size(history.time)
    if count == 0:
        raise InvalidInputError("history: it is empty; there is nothing to draw")
    time = finite_array("history: time", history.time, (count,))
    return time, finite_array("history: q", history.q, (count, robot.nq))


def _error_series(errors: Mapping[str, ArrayLike], count: int) -> list[_Series]:
    looks = cycle([(colour, dashes) for dashes in ("-", "--", ":") for colour in style.SERIES])
    return [
        _Series(name, *look, _norms(f"history: errors of {name!r}", values, count))
        for (name, values), look in zip(errors.items(), looks, strict=False)
    ]


def _norms(what: str, values: ArrayLike, count: int) -> Array:
    try:
        rows = np.asarray(values, dtype=np.float64).reshape(count, -1)
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"{what}: expected numbers, one row for each time") from error
    return np.maximum(np.linalg.norm(rows, axis=1), SMALLEST)


def _inertias(robot: Robot, history: History, q: Array) -> Array:
    given = getattr(history, "inertia", None)
    if given is None:
        return np.array([strung(robot.snapshot(one).inertia) for one in q])
    return finite_array("history: inertia", given, (len(q), 6))


def _moment_series(inertias: Array) -> list[_Series]:
    moments = np.linalg.eigvalsh([matrix(inertia) for inertia in inertias])  # (n, 3) ascending
    return [
        _Series(f"about a{style.INDEX[k]}", style.PRINCIPAL[k], "-", moments[:, k])
        for k in range(3)
    ]


# ---------------------------------------------------------------------- the two plots


def _plot_errors(axes: Axes, time: Array, errors: Iterable[_Series]) -> None:
    style.plain(axes, "Task errors", "time [s]", "norm of the error, own unit")
    series = [*errors]
    # Within a decade a logarithmic axis has no round numbers to show.
    finite = [one.values[np.isfinite(one.values)] for one in series]
    seen = np.concatenate([np.zeros(0), *finite])
    if seen.max(initial=0.0) > DECADE * seen.min(initial=np.inf):
        axes.set_yscale("log")
    else:
        axes.set_ylim(0.0, 1.05 * seen.max(initial=SMALLEST))
    _plot(axes, time, series)


def _plot_moments(axes: Axes, time: Array, moments: Iterable[_Series]) -> None:
    style.plain(axes, "Principal moments of inertia", "time [s]", "kg m²")
    _plot(axes, time, list(moments))


def _plot(axes: Axes, time: Array, series: list[_Series]) -> None:
    marker = "o" if len(time) == 1 else None
    for one in series:
        axes.plot(
            time, one.values, color=one.colour, linestyle=one.dashes, linewidth=1.6, marker=marker
        )
    if len(time) > 1 and time[-1] > time[0]:
        axes.set_xlim(time[0], time[-1])
    _label_ends(axes, [one for one in series if np.isfinite(one.values).any()])


def _label_ends(axes: Axes, series: list[_Series]) -> None:
    """Write each curve's name at its end, moved up or down where two would overlap."""
    axes.autoscale_view()  # or else the limits are found only when the figure is written
    last = [(0.0, one.values[np.isfinite(one.values)][-1]) for one in series]
    to_axes = axes.transData + axes.transAxes.inverted()
    heights = to_axes.transform(np.reshape(last, (-1, 2)))[:, 1]
    for one, height in zip(series, spread(heights, LABEL_GAP), strict=True):
        axes.text(
            1.02,
            height,
            one.label if len(one.label) <= LONGEST else one.label[: LONGEST - 1] + "…",
            color=one.colour,
            fontsize=style.SMALL,
            va="center",
            transform=axes.transAxes,
        )


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
