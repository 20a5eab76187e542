"""A run in phases in one figure: the robot at the end of each, and all plots over one time axis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.validate import Array
from wbc.view import style
from wbc.view.portrait import draw_portraits, portraits_of, shape_of
from wbc.view.series import Series, plot_errors, plot_moments, shortened

WIDTH = 12.0  # inches
ROW = 6  # portraits side by side, at most
FEWEST = 4  # fewer are not drawn larger than a quarter
PANEL_SHAPE = (0.9, 1.7)  # height to width, at least and at most
HEADING, TITLE, BELOW_PANEL = 0.45, 0.5, 0.3  # inches
PLOT, NAMES = 1.95, 1.1  # inches, of a plot and, all in all, of the phases' names and the times
BAND = "#F1F3F6"  # behind every other phase
SLANT = 32.0  # degrees
LEAST_ERROR = 1e-7  # errors below are of no interest


@dataclass(frozen=True)
class PhaseSpan:
    """A phase: its name, what was stood on, its time [s] and the row in which it has ended."""

    name: str
    support: str
    begins: float
    ends: float
    last: int


@dataclass(frozen=True, eq=False)
class PhasedRun:
    """What is drawn of a run.

    Attributes
    ----------
    time, q:
        (n,) [s] and (n, nq).
    balance:
        (n,) margin [m], NaN where there is none; or None.
    """

    time: Array
    q: Array
    phases: Sequence[PhaseSpan]
    balance: Array | None
    errors: Sequence[Series]
    moments: Sequence[Series]


def phases_of(history: object, time: Array) -> list[PhaseSpan]:
    """Return the phases of a history in order; none if it has no phases.

    Raises
    ------
    InvalidInputError
        Not one name for each time.
    """
    names = _words(history, "phase", len(time))
    if names is None or not any(names):
        return []
    supports = _words(history, "support", len(time)) or [""] * len(names)
    firsts = [k for k in range(len(names)) if k == 0 or names[k] != names[k - 1]]
    # A phase has ended in the state with which the next one begins.
    lasts = [*firsts[1:], len(names) - 1]
    return [
        PhaseSpan(names[k], supports[k], float(time[k]), float(time[last]), last)
        for k, last in zip(firsts, lasts, strict=True)
    ]


def balance_of(history: object, count: int) -> Array | None:
    """Return the balance margin (count,) [m] of a history; None if it has none.

    Raises
    ------
    InvalidInputError
        Not one number for each time.
    """
    given = getattr(history, "balance", None)
    if given is None:
        return None
    try:
        balance = np.asarray(given, dtype=np.float64).reshape(count)
    except (TypeError, ValueError) as error:
        raise InvalidInputError("history: balance: expected one number for each time") from error
    return balance if np.isfinite(balance).any() else None


def _words(history: object, name: str, count: int) -> list[str] | None:
    given = getattr(history, name, None)
    if given is None:
        return None
    words = [str(word) for word in np.ravel(given)]
    if len(words) != count:
        raise InvalidInputError(f"history: {name}: expected {count} words, got {len(words)}")
    return words


def phased_figure(robot: Robot, run: PhasedRun, title: str) -> Figure:
    """Return the figure of a run with phases."""
    configurations = {f"start\n{_standing(run.phases[0])}": run.q[0]}
    configurations |= {
        f"{k}  {shortened(phase.name)}, {phase.ends:.1f} s\n{_standing(phase)}": run.q[phase.last]
        for k, phase in enumerate(run.phases, start=1)
    }
    portraits = portraits_of(robot, configurations)
    rows = math.ceil(len(portraits) / ROW)
    columns = math.ceil(len(portraits) / rows)
    width = WIDTH / max(columns, FEWEST)
    margin = 0.5 * (WIDTH - columns * width)
    high = width * float(np.clip(shape_of(portraits), *PANEL_SHAPE))
    count = 2 if run.balance is None else 3
    below = NAMES + count * PLOT
    total = HEADING + rows * (TITLE + high + BELOW_PANEL) + below
    figure = style.sheet(WIDTH, total, title, below)
    panels = []
    for k in range(len(portraits)):
        row, column = divmod(k, columns)
        bottom = total - HEADING - (row + 1) * (TITLE + high + BELOW_PANEL) + BELOW_PANEL
        left = (margin + column * width) / WIDTH
        panels.append(figure.add_axes((left, bottom / total, width / WIDTH, high / total)))
    draw_portraits(panels, portraits)
    figure.text(0.99, 1.0 - 0.16 / total, "semi-axes in mm", ha="right", va="top",
                fontsize=style.SMALL, color=style.GREY)  # fmt: skip
    _draw_plots(figure.subplots(count, 1, sharex=True), run)
    return figure


def _standing(phase: PhaseSpan) -> str:
    names = phase.support.split(",")
    return f"on {' and '.join(names)}" if phase.support else ""


def _draw_plots(axes: Sequence[Axes], run: PhasedRun) -> None:
    """Draw the plots below each other, with one time axis."""
    for one in axes:
        _mark_phases(one, run.phases)
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


def _mark_phases(axes: Axes, phases: Sequence[PhaseSpan]) -> None:
    for k, phase in enumerate(phases):
        if k % 2 == 0:
            axes.axvspan(phase.begins, phase.ends, color=BAND, linewidth=0.0, zorder=0)


def _write_names(axes: Axes, phases: Sequence[PhaseSpan]) -> None:
    """Write the phases' names above the first plot, slanted, so that short phases have room."""
    axes.set_title("", loc="left")  # the names take its place; the axis says what is drawn
    for k, phase in enumerate(phases, start=1):
        axes.text(
            0.5 * (phase.begins + phase.ends),
            1.04,
            f"{k}  {shortened(phase.name)}",
            rotation=SLANT,
            rotation_mode="anchor",
            ha="left",
            va="bottom",
            fontsize=style.SMALL,
            color=style.BLACK,
            transform=axes.get_xaxis_transform(),
        )


def _plot_balance(axes: Axes, time: Array, balance: Array) -> None:
    style.plain(axes, "", "time [s]", "balance margin [mm]")
    axes.plot(time, 1e3 * balance, color=style.BLUE, linewidth=1.6)
    if len(time) > 1:
        axes.set_xlim(time[0], time[-1])
    worst = int(np.nanargmin(balance))
    axes.plot(time[worst], 1e3 * balance[worst], "o", color=style.VERMILION, markersize=4)
    axes.annotate(
        f"least {1e3 * balance[worst]:.1f} mm",
        (time[worst], 1e3 * balance[worst]),
        xytext=(4, -4),
        textcoords="offset points",
        va="top",
        fontsize=style.SMALL,
        color=style.VERMILION,
    )
    low, high = axes.get_ylim()
    axes.set_ylim(min(0.0, low), high + 0.05 * (high - low))
    axes.axhline(0.0, color=style.VERMILION, linewidth=0.8)
