"""A run of a controller in one figure: the robot, and the errors and inertias over time.

A run without phases shows the robot before and after; a run with phases at the end of each, and
all plots over one time axis.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from wbc.motion.dropouts import runs
from wbc.robot import Robot
from wbc.validate import Array
from wbc.view import style
from wbc.view.history import DrawableRun, HistoryLike, PhaseSpan, read_history
from wbc.view.options import View
from wbc.view.portrait import DEFAULT, LINE, portraits_of, sheet_with_portraits
from wbc.view.series import Series, plot_curves, plot_errors, plot_moments, shortened

WIDTH = 9.0  # inches
PANEL_SHAPE = (0.55, 0.95)  # height to width, at least and at most
HEADING, PLOT = 0.65, 2.9  # inches
BELOW = (0.36, 0.09)  # inches of the semi-axes below a picture, and below the caption


def plot_run(
    robot: Robot, history: HistoryLike, path: str | Path, *, title: str = "", view: View = DEFAULT
) -> Path:
    """Draw a run: the robot before and after, its tasks' errors and its principal moments.

    A run with phases is drawn at the end of each, with the phases marked in the plots and its
    balance in one more. Of a run with constraints, what was left of them and what held the robot
    back are plotted too.

    Parameters
    ----------
    history:
        The run. Its ``inertia`` (n, 6), entries xx xy xz yy yz zz [kg m^2], is computed from ``q``
        if it has none. Errors may be NaN where a task was not active. It has phases if it has a
        ``phase`` (n,) that is not empty: the name of the phase at each time; it then may have a
        ``support`` (n,), what the robot stood on, and a ``balance`` (n,), the margin [m]. What else
        it may have is that of :class:`wbc.run.History`: ``clearance``, ``active``, ``obstacles``,
        ``points`` and ``targets``.
    path:
        The file, which is returned: png, svg or pdf by its suffix.
    title:
        Above the picture.
    view:
        What is drawn of the robot, and from where.

    Raises
    ------
    InvalidInputError
        Another suffix, no such folder, an empty history or one whose arrays do not fit together.
    ModelError
        The robot's meshes cannot be read.
    """
    path = style.picture_file(path)
    return style.save(run_figure(robot, history, title=title, view=view), path)


def run_figure(
    robot: Robot, history: HistoryLike, *, title: str = "", view: View = DEFAULT
) -> Figure:
    """Return the figure that :func:`plot_run` writes."""
    run = read_history(robot, history)
    if run.phases:
        return _phased_figure(robot, run, title, view)
    start, end = run.time[[0, -1]]
    ends = {
        f"before, t = {start:g} s": run.pose(0),
        f"after, t = {end:g} s": run.pose(len(run.time) - 1),
    }
    portraits = portraits_of(robot, ends, view)
    why = [*explanation_plots(run)]
    rows = 2 if why else 1
    figure = sheet_with_portraits(
        portraits, 0.5 * WIDTH, PANEL_SHAPE, columns=2, title=title, above=(HEADING, 0.0),
        below=BELOW, plots=rows * PLOT,
    )  # fmt: skip
    grid = figure.add_gridspec(rows, 2)
    plot_errors(figure.add_subplot(grid[0, 0]), run.time, run.errors)
    plot_moments(figure.add_subplot(grid[0, 1]), run.time, run.moments)
    for k, draw in enumerate(why):
        place = grid[1, k] if len(why) > 1 else grid[1, :]
        draw(figure.add_subplot(place))
    return figure


def explanation_plots(run: DrawableRun) -> Iterator[Callable[[Axes], None]]:
    """Yield functions that plot clearances and what held the robot back."""
    if run.clearance:
        yield lambda axes: plot_clearance(axes, run.time, run.clearance, run.clearance_unit)
    if run.active:
        yield lambda axes: plot_held_back(axes, run.time, run.active)


# ---------------------------------------------------------------------- what held it back

LINEAR = 1.0  # mm: nearer to zero the axis is linear, beyond it is logarithmic
MOST_ROWS = 9  # rows shown, those that held back the longest
BAR_WIDTH = 0.62  # of a bar, part of a row
EDGE = 1.0  # points: a bar of one tick of a long run is seen by it
LABEL_LENGTH = 34  # characters of a row's label


def plot_clearance(
    axes: Axes, time: Array, clearance: Mapping[str, Array], units: Mapping[str, str]
) -> None:
    """Draw the clearance of each constraint; below zero it is violated. Angles say their unit."""
    style.plain(axes, "Clearance of the constraints", "time [s]", "distance [mm]")
    looks = cycle(style.SERIES)
    series = [
        Series(name, colour, "-", 1e3 * left)
        if (unit := units.get(name, "m")) == "m"
        else Series(f"{name} [{unit}]", colour, "-", left)
        for (name, left), colour in zip(clearance.items(), looks, strict=False)
    ]
    axes.set_yscale("symlog", linthresh=LINEAR)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    seen = np.concatenate([one.values[np.isfinite(one.values)] for one in series])
    low, high = seen.min(initial=0.0), seen.max(initial=0.0)  # nothing may be near all the time
    axes.set_ylim(min(-0.1, 1.5 * float(low)), max(1.0, 1.5 * float(high)))
    axes.axhline(0.0, color=style.VERMILION, linewidth=0.8)
    plot_curves(axes, time, series)


def plot_held_back(axes: Axes, time: Array, active: Mapping[str, NDArray[np.bool_]]) -> None:
    """Draw when each row held the robot back, those that did so the longest on top."""
    longest = sorted(active, key=lambda label: -int(np.count_nonzero(active[label])))
    shown = longest[:MOST_ROWS]
    more = len(longest) - len(shown)
    title = "Held back by" + (f" (and {more} more)" if more else "")
    style.plain(axes, title, "time [s]", "")
    dt = float(time[1] - time[0]) if len(time) > 1 else 1.0
    for row, label in enumerate(shown):
        bars = [(float(time[a]), float(time[b - 1] - time[a] + dt)) for a, b in runs(active[label])]
        colour = style.SERIES[row % len(style.SERIES)]
        axes.broken_barh(bars, (row - 0.5 * BAR_WIDTH, BAR_WIDTH), color=colour, linewidth=EDGE)
    axes.set_xlim(float(time[0]), float(time[-1]) + (dt if len(time) == 1 else 0.0))
    axes.set_ylim(max(len(shown), 3) - 0.5, -0.5)
    axes.set_yticks(range(len(shown)), [shortened(label, LABEL_LENGTH) for label in shown])
    axes.tick_params(axis="y", labelsize=style.SMALL - 1.5, length=0)
    axes.grid(visible=False, axis="y")


# ---------------------------------------------------------------------- runs in phases

PHASED_WIDTH = 12.0  # inches
ROW = 6  # portraits side by side, at most
FEWEST = 4  # fewer are not drawn larger than a quarter
PHASED_SHAPE = (0.9, 1.7)  # height to width, at least and at most
TOP, TITLE, BELOW_PANEL = 0.45, 0.5, 0.3  # inches
ROW_OF_PLOTS = 1.95  # inches
NAMES = 1.1  # inches, all in all of the phases' names and the times
BAND = "#F1F3F6"  # behind every other phase
SLANT = 32.0  # degrees


def _phased_figure(robot: Robot, run: DrawableRun, title: str, view: View) -> Figure:
    configurations = {f"start\n{run.phases[0].standing}": run.pose(0, now=True)}
    configurations |= {
        f"{k}  {shortened(phase.name)}, {phase.ends:.1f} s\n{phase.standing}": run.pose(
            phase.last, phase.support, now=True
        )
        for k, phase in enumerate(run.phases, start=1)
    }
    portraits = portraits_of(robot, configurations, view)
    columns = math.ceil(len(portraits) / math.ceil(len(portraits) / ROW))
    plots = [*_plots(run)]
    figure = sheet_with_portraits(
        portraits, PHASED_WIDTH / max(columns, FEWEST), PHASED_SHAPE, columns=columns, title=title,
        width=PHASED_WIDTH, above=(TOP, TITLE), below=(BELOW_PANEL, LINE),
        plots=NAMES + len(plots) * ROW_OF_PLOTS,
    )  # fmt: skip
    figure.text(0.99, 1.0 - 0.16 / figure.get_figheight(), "semi-axes in mm", ha="right", va="top",
                fontsize=style.SMALL, color=style.GREY)  # fmt: skip
    _draw_plots(figure.subplots(len(plots), 1, sharex=True), run, plots)
    return figure


def _plots(run: DrawableRun) -> Iterator[Callable[[Axes], None]]:
    if run.balance is not None:
        balance = run.balance
        yield lambda axes: _plot_balance(axes, run.time, balance)
    yield lambda axes: _plot_moments(axes, run)
    yield lambda axes: plot_errors(axes, run.time, run.errors)
    yield from explanation_plots(run)


def _plot_moments(axes: Axes, run: DrawableRun) -> None:
    plot_moments(axes, run.time, run.moments)
    axes.set_ylabel("moments of inertia [kg m²]", fontsize=style.SMALL)


def _draw_plots(
    axes: Sequence[Axes], run: DrawableRun, plots: Sequence[Callable[[Axes], None]]
) -> None:
    for one, draw in zip(axes, plots, strict=True):
        for phase in run.phases[::2]:
            one.axvspan(phase.begins, phase.ends, color=BAND, linewidth=0.0, zorder=0)
        draw(one)
    _write_names(axes[0], run.phases)
    for one in axes[:-1]:
        one.set_xlabel("")


def _write_names(axes: Axes, phases: Sequence[PhaseSpan]) -> None:
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
