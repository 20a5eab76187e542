"""A run of a controller in one figure: the robot, and the errors and inertias over time.

A run without phases shows the robot before and after; a run with phases at the end of each, and
all plots over one time axis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.spatial import vech
from wbc.validate import Array, finite_array
from wbc.view import style
from wbc.view.portrait import draw_portraits, portraits_of, shape_of
from wbc.view.series import (
    Series,
    error_series,
    moment_series,
    plot_errors,
    plot_moments,
    shortened,
)

WIDTH = 9.0  # inches
PANEL_SHAPE = (0.55, 0.95)  # height to width, at least and at most
HEADING, BETWEEN, PLOT = 0.65, 0.45, 2.9  # inches, from the top


class History(Protocol):
    """What a run leaves behind; more is drawn if there is more, see :func:`plot_run`."""

    @property
    def time(self) -> ArrayLike:
        """Times (n,) [s]."""

    @property
    def q(self) -> ArrayLike:
        """Configurations (n, nq)."""

    @property
    def errors(self) -> Mapping[str, ArrayLike]:
        """Error of each task, (n, k) or (n,)."""


def plot_run(robot: Robot, history: History, path: str | Path, *, title: str) -> Path:
    """Draw a run: the robot before and after, its tasks' errors and its principal moments.

    A run with phases is drawn at the end of each, with the phases marked in the plots and its
    balance in one more.

    Parameters
    ----------
    history:
        The run. Its ``inertia`` (n, 6), entries xx xy xz yy yz zz [kg m^2], is computed from ``q``
        if it has none. Errors may be NaN where a task was not active. It has phases if it has a
        ``phase`` (n,) that is not empty: the name of the phase at each time; it then may have a
        ``support`` (n,), what the robot stood on, and a ``balance`` (n,), the margin [m].
    path:
        The file, which is returned: png, svg or pdf by its suffix.

    Raises
    ------
    InvalidInputError
        Another suffix, no such folder, an empty history or one whose arrays do not fit together.
    ModelError
        The robot's meshes cannot be read.
    """
    path = style.picture_file(path)
    style.save(run_figure(robot, history, title=title), path)
    return path


def run_figure(robot: Robot, history: History, *, title: str) -> Figure:
    """Return the figure that :func:`plot_run` writes."""
    run = _read(robot, history)
    if run.phases:
        return _phased_figure(robot, run, title)
    start, end = run.time[[0, -1]]
    ends = {f"before, t = {start:g} s": run.q[0], f"after, t = {end:g} s": run.q[-1]}
    portraits = portraits_of(robot, ends)
    half = 0.5 * WIDTH
    high = half * float(np.clip(shape_of(portraits), *PANEL_SHAPE))
    below = BETWEEN + PLOT
    figure = style.sheet(WIDTH, HEADING + high + below, title, PLOT)
    draw_portraits([style.place(figure, k * half, below, half, high) for k in range(2)], portraits)
    left, right = figure.subplots(1, 2)
    plot_errors(left, run.time, run.errors)
    plot_moments(right, run.time, run.moments)
    return figure


# ---------------------------------------------------------------------- reading the history


@dataclass(frozen=True)
class _Phase:
    """A phase: its name, what was stood on, its time [s] and the row in which it has ended."""

    name: str
    support: str
    begins: float
    ends: float
    last: int

    @property
    def standing(self) -> str:
        return f"on {' and '.join(self.support.split(','))}" if self.support else ""


@dataclass(frozen=True, eq=False)
class _Run:
    """What is drawn of a run; without phases none, without any balance None."""

    time: Array  # (n,) [s]
    q: Array  # (n, nq)
    errors: Sequence[Series]
    moments: Sequence[Series]
    phases: Sequence[_Phase]
    balance: Array | None  # (n,) margin [m], NaN where there is none


def _read(robot: Robot, history: History) -> _Run:
    count = np.size(history.time)
    if count == 0:
        raise InvalidInputError("history: it is empty; there is nothing to draw")
    time = finite_array("history: time", history.time, (count,))
    q = finite_array("history: q", history.q, (count, robot.nq))
    inertia, balance = getattr(history, "inertia", None), getattr(history, "balance", None)
    if inertia is None:
        inertia = [vech(robot.snapshot(one).inertia) for one in q]
    moments = moment_series(finite_array("history: inertia", inertia, (count, 6)))
    if balance is not None:
        try:
            balance = np.asarray(balance, dtype=np.float64).reshape(count)
        except (TypeError, ValueError) as error:
            what = "history: balance: expected one number for each time"
            raise InvalidInputError(what) from error
        balance = balance if np.isfinite(balance).any() else None
    errors = error_series(history.errors, count)
    return _Run(time, q, errors, moments, _phases(history, time), balance)


def _phases(history: History, time: Array) -> list[_Phase]:
    """Return the phases of a history in order; none if it has no phases."""
    names = _words(history, "phase", len(time))
    if not any(names):
        return []
    supports = _words(history, "support", len(time))
    firsts = [k for k in range(len(names)) if k == 0 or names[k] != names[k - 1]]
    # A phase has ended in the state with which the next one begins.
    lasts = [*firsts[1:], len(names) - 1]
    return [
        _Phase(names[k], supports[k], float(time[k]), float(time[last]), last)
        for k, last in zip(firsts, lasts, strict=True)
    ]


def _words(history: History, name: str, count: int) -> list[str]:
    """Return a word for each time, all empty if the history has none."""
    given = getattr(history, name, None)
    if given is None:
        return [""] * count
    words = [str(word) for word in np.ravel(given)]
    if len(words) != count:
        raise InvalidInputError(f"history: {name}: expected {count} words, got {len(words)}")
    return words


# ---------------------------------------------------------------------- runs in phases

PHASED_WIDTH = 12.0  # inches
ROW = 6  # portraits side by side, at most
FEWEST = 4  # fewer are not drawn larger than a quarter
PHASED_SHAPE = (0.9, 1.7)  # height to width, at least and at most
TOP, TITLE, BELOW_PANEL = 0.45, 0.5, 0.3  # inches
ROW_OF_PLOTS, NAMES = (
    1.95,
    1.1,
)  # inches, of a plot and, all in all, of the phases' names and the times
BAND = "#F1F3F6"  # behind every other phase
SLANT = 32.0  # degrees
LEAST_ERROR = 1e-7  # errors below are of no interest


def _phased_figure(robot: Robot, run: _Run, title: str) -> Figure:
    """Return the figure of a run with phases."""
    configurations = {f"start\n{run.phases[0].standing}": run.q[0]}
    configurations |= {
        f"{k}  {shortened(phase.name)}, {phase.ends:.1f} s\n{phase.standing}": run.q[phase.last]
        for k, phase in enumerate(run.phases, start=1)
    }
    portraits = portraits_of(robot, configurations)
    rows = math.ceil(len(portraits) / ROW)
    columns = math.ceil(len(portraits) / rows)
    width = PHASED_WIDTH / max(columns, FEWEST)
    margin = 0.5 * (PHASED_WIDTH - columns * width)
    high = width * float(np.clip(shape_of(portraits), *PHASED_SHAPE))
    count = 2 if run.balance is None else 3
    below, pitch = NAMES + count * ROW_OF_PLOTS, TITLE + high + BELOW_PANEL
    total = TOP + rows * pitch + below
    figure = style.sheet(PHASED_WIDTH, total, title, below)
    panels = []
    for k in range(len(portraits)):
        row, column = divmod(k, columns)
        bottom = total - TOP - (row + 1) * pitch + BELOW_PANEL
        panels.append(style.place(figure, margin + column * width, bottom, width, high))
    draw_portraits(panels, portraits)
    figure.text(0.99, 1.0 - 0.16 / total, "semi-axes in mm", ha="right", va="top",
                fontsize=style.SMALL, color=style.GREY)  # fmt: skip
    _draw_plots(figure.subplots(count, 1, sharex=True), run)
    return figure


def _draw_plots(axes: Sequence[Axes], run: _Run) -> None:
    """Draw the plots below each other, with one time axis."""
    for one in axes:
        for phase in run.phases[::2]:
            one.axvspan(phase.begins, phase.ends, color=BAND, linewidth=0.0, zorder=0)
    if run.balance is not None:
        _plot_balance(axes[0], run.time, run.balance)
    plot_moments(axes[-2], run.time, run.moments)
    axes[-2].set_ylabel("moments of inertia [kg m²]", fontsize=style.SMALL)
    plot_errors(axes[-1], run.time, run.errors)
    if axes[-1].get_yscale() == "log":
        axes[-1].set_ylim(bottom=max(axes[-1].get_ylim()[0], LEAST_ERROR))
    _write_names(axes[0], run.phases)
    for one in axes[:-1]:
        one.set_xlabel("")


def _write_names(axes: Axes, phases: Sequence[_Phase]) -> None:
    """Write the phases' names above the first plot, slanted, so that short phases have room."""
    axes.set_title("", loc="left")  # the names take its place; the axis says what is drawn
    for k, phase in enumerate(phases, start=1):
        axes.text(
            0.5 * (phase.begins + phase.ends), 1.04, f"{k}  {shortened(phase.name)}",
            rotation=SLANT, rotation_mode="anchor", ha="left", va="bottom", fontsize=style.SMALL,
            color=style.BLACK, transform=axes.get_xaxis_transform(),
        )  # fmt: skip


def _plot_balance(axes: Axes, time: Array, balance: Array) -> None:
    style.plain(axes, "", "time [s]", "balance margin [mm]")
    axes.plot(time, 1e3 * balance, color=style.BLUE, linewidth=1.6)
    if len(time) > 1:
        axes.set_xlim(time[0], time[-1])
    worst = int(np.nanargmin(balance))
    lowest = time[worst], 1e3 * balance[worst]
    axes.plot(*lowest, "o", color=style.VERMILION, markersize=4)
    axes.annotate(
        f"least {lowest[1]:.1f} mm", lowest, xytext=(4, -4), textcoords="offset points",
        va="top", fontsize=style.SMALL, color=style.VERMILION,
    )  # fmt: skip
    low, high = axes.get_ylim()
    axes.set_ylim(min(0.0, low), high + 0.05 * (high - low))
    axes.axhline(0.0, color=style.VERMILION, linewidth=0.8)
