"""Plots of a pendulum's motion: phase portrait, points on the ground, momentum and masses."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from scipy.spatial.transform import Rotation

from wbc.problem.pendulum.result import PendulumHistory
from wbc.validate import Array
from wbc.view import style

WIDTH, HEIGHT = 2.05, 2.2  # inches
LEAST_SPAN = 0.02  # a plot's axis spans this at least, in its unit: rounding is not to be seen
STATIONARY = 0.02  # m: a foot that moves less stands still
AXES = ("about x", "about y", "about z")
TICKS = 4  # intervals between ticks along x, at most
ROW, MARGIN = 0.125, 0.1  # inches: a row of a legend, and what is around all of them
# Lines of the points on the ground: the wider below, so that each is seen where they coincide.
CMP, COM, COP = 2.6, 1.1, 1.4

SOLID = np.sqrt(5.0 / 3.0)  # semi-axis of the equimomental ellipsoid over r_k

Range = tuple[float, float]
Draw = Callable[[Axes, PendulumHistory], None]


def plots_of(history: PendulumHistory) -> tuple[Draw, Draw, Draw]:
    """Return what draws the plots of a pendulum, each called with axes and the history."""
    return draw_portrait if has_portrait(history) else draw_axes_rates, draw_ground, draw_momentum


def has_portrait(history: PendulumHistory) -> bool:
    """Return whether leg or CoM move: if not, a phase portrait is a point."""
    x, y, _, _ = _portrait_coordinate(history)
    return bool(np.ptp(x) > LEAST_SPAN or np.ptp(y) > LEAST_SPAN)


def draw_axes_rates(axes: Axes, history: PendulumHistory) -> None:
    """Draw how fast the masses' axes turn over time."""
    style.plain(axes, "Turning of the masses", "time [s]", "rate [rad/s]")
    time = history.time
    step = Rotation.from_matrix(history.axes[1:] @ history.axes[:-1].transpose(0, 2, 1))
    rate = step.as_rotvec() / np.diff(time)[:, None]
    middle, parts = 0.5 * (time[1:] + time[:-1]), _components(history, rate)
    for (name, values), colour in zip(parts.items(), style.SERIES, strict=False):
        axes.plot(middle, values, color=colour, linewidth=1.2, label=name)
    axes.set_ylim(*_at_least(axes.get_ylim(), LEAST_SPAN))
    _ticks(axes)
    _legend(axes, axes.get_lines(), 3)


def _components(history: PendulumHistory, vectors: Array) -> dict[str, Array]:
    """Return the components of vectors (n, 3) by name; a planar pendulum turns about -y."""
    return {"about -y": -vectors[:, 1]} if history.flat else dict(zip(AXES, vectors.T, strict=True))


def draw_portrait(axes: Axes, history: PendulumHistory) -> None:
    """Draw the leg's angle, or where the CoM is, against its rate, each phase in a colour."""
    x, y, across, along = _portrait_coordinate(history)
    style.plain(axes, "Phase portrait", across, along)
    names = list(dict.fromkeys(history.phase))
    for k, name in enumerate(names):
        inside = np.array([phase == name for phase in history.phase])
        inside[1:] |= inside[:-1]  # no gaps between phases
        colour = style.SERIES[k % len(style.SERIES)]
        axes.plot(np.where(inside, x, np.nan), y, color=colour, linewidth=1.2, label=name)
    ends: dict[str, Any] = {"color": style.BLACK, "markersize": 4, "linestyle": "none"}
    axes.plot(x[0], y[0], marker="o", label="start", **ends)
    axes.plot(x[-1], y[-1], marker="s", label="end", **ends)
    axes.set_xlim(*_at_least(axes.get_xlim(), LEAST_SPAN))
    axes.set_ylim(*_at_least(axes.get_ylim(), LEAST_SPAN))
    _ticks(axes)
    _legend(axes, axes.get_lines(), 2)


def _portrait_coordinate(history: PendulumHistory) -> tuple[Array, Array, str, str]:
    """Return a coordinate (n,), its rate (n,), and what they are called."""
    leg, rate = history.com - history.foot, history.com_velocity
    stays = not np.isnan(leg).any() and float(np.ptp(history.foot, axis=0).max()) < STATIONARY
    if stays:
        side = view_side(history)
        across, up = leg @ side, leg[:, 2]
        angle, length = np.unwrap(np.arctan2(across, up)), np.linalg.norm(leg, axis=1)
        # A leg that is only bent and stretched, as in a squat, is told by its height.
        if np.ptp(length) <= max(float(np.ptp(angle) * length.mean()), LEAST_SPAN):
            speed = ((rate @ side) * up - rate[:, 2] * across) / (across**2 + up**2)
            return np.degrees(angle), speed, "leg from the vertical [°]", "rate [rad/s]"
    # What goes somewhere is told by its sway or its height; else by what moves most.
    goes = len(history.supports) > 1 or bool(np.isnan(history.foot).any())
    choices = (2,) if history.flat else (1, 2) if goes else (0, 1, 2)
    k = max(choices, key=lambda one: float(np.ptp(history.com[:, one])))
    what = ("forward, x", "sideways, y", "height")[k]
    return history.com[:, k], rate[:, k], f"{what} of the CoM [m]", "rate [m/s]"


def view_side(history: PendulumHistory) -> Array:
    """Return the horizontal direction (3,) in which most happens."""
    if history.flat:
        return np.array((1.0, 0.0, 0.0))
    moved = history.com[:, :2] - history.com[:, :2].mean(axis=0)
    spun = history.momentum[:, 1::-1] * (-1.0, 1.0)  # turning about y swings along x
    total = moved.T @ moved
    if float(np.trace(total)) < 1e-8 * len(moved):
        total = spun.T @ spun
    direction = np.linalg.eigh(total)[1][:, -1]
    direction = direction * np.sign(direction[np.abs(direction).argmax()])
    return np.array((*direction.tolist(), 0.0))


def draw_ground(axes: Axes, history: PendulumHistory) -> None:
    """Draw CoM, CoP and CMP on the ground, or over time where they move on a line."""
    if history.flat:
        style.plain(axes, "On the ground", "time [s]", "x [m]")
        for support in history.supports:
            low, high = support.polygon[:, 0].min(), support.polygon[:, 0].max()
            span = (support.start, support.end)
            axes.fill_between(span, low, high, color=style.GREY, alpha=0.25, linewidth=0)
        traces = _traces(axes, history, over_time=True)
        axes.set_ylim(*_plot_range(history, 0))
    else:
        style.plain(axes, "On the ground", "x [m]", "y [m]")
        for support in history.supports:
            axes.add_patch(
                Polygon(support.polygon, facecolor=style.GREY, alpha=0.22, edgecolor=style.GREY)
            )
        traces = _traces(axes, history, over_time=False)
        _square(axes, _plot_range(history, 0), _plot_range(history, 1))
    _ticks(axes)
    _legend(axes, traces, 3)


def _traces(axes: Axes, history: PendulumHistory, *, over_time: bool) -> list[Line2D]:
    """Draw x of the three points over time, or y over x, each with a dot at its end.

    The CMP is left out while the CoM hangs below the foot: it says how the ground holds up a CoM.
    """
    drawn = []
    stands = ~(history.com[:, 2:] <= history.foot[:, 2:])  # in the air there is no foot
    for points, colour, width, name in (
        (np.where(stands, history.cmp, np.nan), style.ORANGE, CMP, "CMP"),
        (history.com, style.BLACK, COM, "CoM"),
        (history.cop, style.BLUE, COP, "CoP"),
    ):
        x, y = (history.time, points[:, 0]) if over_time else points[:, :2].T
        drawn += axes.plot(x, y, color=colour, linewidth=width, label=name)
        known = np.flatnonzero(~np.isnan(points[:, 0]))
        # What never moves would not be seen without it.
        if len(known):
            last = known[-1:]
            axes.plot(x[last], y[last], "o", color=colour, markersize=1.2 + 1.6 * width)
    return drawn


def _square(axes: Axes, x: Range, y: Range) -> None:
    """Show both ranges at the same scale, below the room for the legend."""
    sizes = (WIDTH, HEIGHT - MARGIN - ROW)  # inches
    scale = max((high - low) / inches for (low, high), inches in zip((x, y), sizes, strict=True))
    axes.set_xlim(*_at_least(x, scale * sizes[0]))
    axes.set_ylim(*_at_least(y, scale * sizes[1]))


def _plot_range(history: PendulumHistory, k: int) -> Range:
    """Return the range of a coordinate: all of CoM, CoP and supports, not all of a far-off CMP."""
    inner = [history.com[:, k], history.cop[:, k]]
    inner += [support.polygon[:, k] for support in history.supports]
    low = min(float(np.nanmin(part, initial=np.inf)) for part in inner)
    high = max(float(np.nanmax(part, initial=-np.inf)) for part in inner)
    size = max(high - low, LEAST_SPAN)
    far = history.cmp[~(history.com[:, 2] <= history.foot[:, 2]), k]
    low = max(min(low, float(np.nanmin(far, initial=low))), low - size)
    high = min(max(high, float(np.nanmax(far, initial=high))), high + size)
    return _at_least((low - 0.06 * size, high + 0.06 * size), LEAST_SPAN)


def draw_momentum(axes: Axes, history: PendulumHistory) -> None:
    """Draw the angular momentum about the CoM and, on a second axis, the masses' distances."""
    style.plain(axes, "Momentum and masses", "time [s]", "angular momentum [kg m²/s]")
    parts = _components(history, history.momentum)
    for (name, values), colour in zip(parts.items(), style.SERIES, strict=False):
        axes.plot(history.time, values, color=colour, linewidth=1.2, label=name)
    # Constant to rounding: a line, not noise blown up to the size of the plot.
    largest = max(float(np.abs(values).max()) for values in parts.values())
    axes.set_ylim(*_at_least(axes.get_ylim(), 0.04 * max(largest, 1.0)))
    second = style.right_axis(axes, "distance of the masses [m]", style.BLACK)
    named = {f"r{style.INDEX[k]}": history.radii[:, k] for k in range(3)}
    if history.flat:
        named = {"r": history.radii[:, 0]}
    for (name, values), colour in zip(named.items(), style.PRINCIPAL, strict=False):
        second.plot(
            history.time, values, label=name, color=colour, linewidth=1.0, linestyle=(0, (4, 2))
        )
    second.set_ylim(0.0, 1.05 * max(float(history.radii.max()), 1e-3))
    _ticks(axes)
    _ticks(second)
    _legend(second, [*axes.get_lines(), *second.get_lines()], 2, also=axes)


def _at_least(limits: Range, least: float) -> Range:
    """Return a range, made as long as ``least`` about its middle if it is shorter."""
    low, high = limits
    middle, half = 0.5 * (low + high), 0.5 * max(high - low, least)
    return middle - half, middle + half


def _ticks(axes: Axes) -> None:
    """Write numbers in full, short ones: a factor at the axis' end would stand on the labels."""
    axes.locator_params(axis="x", nbins=TICKS)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(lambda x, _: f"{x:.4g}".replace("-", "−"))  # noqa: RUF001


def _legend(axes: Axes, lines: Iterable[Line2D], columns: int, also: Axes | None = None) -> None:
    """Put a legend above all that is drawn in ``axes``, and in ``also``, which shares its place."""
    entries = [line for line in lines if not str(line.get_label()).startswith("_")]
    room = MARGIN + ROW * math.ceil(len(entries) / columns)
    for each in (axes,) if also is None else (axes, also):
        low, high = each.get_ylim()
        each.set_ylim(low, high + (high - low) * room / (HEIGHT - room))
    axes.legend(
        entries, [str(line.get_label()) for line in entries], loc="upper left", ncols=columns,
        fontsize=style.SMALL - 1.5, edgecolor="none", handlelength=1.2, columnspacing=1.0,
        borderpad=0.2, labelspacing=0.25,
        framealpha=0.85,  # a far-off CMP runs behind it
    )  # fmt: skip
