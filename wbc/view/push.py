"""Survived pushes by direction, in polar plots, with theoretical bounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from wbc.simulation import PushMap
from wbc.simulation.push_bounds import PushBounds
from wbc.simulation.push_map import FELL, SURVIVED, compare_maps
from wbc.validate import Array
from wbc.view import style

Others = Sequence[PushMap]
WIDTH, HEIGHT, LEGEND = 4.6, 4.6, 0.6  # inches of a plot, and of what is written below
DOT = 10.0  # points^2
RINGS = 5  # circles of the grid, about
SIDES = ((0.0, "forwards"), (0.5 * np.pi, "left"), (np.pi, "back"), (1.5 * np.pi, "right"))


def pushes_figure(maps: Sequence[PushMap], *, duration: float) -> Figure:
    """Return a figure of maps of pushes side by side in parts of M omega d, and in N s.

    ``maps``: the second is drawn as a line into the plots of the first, and as dots in one of its
    own.
    ``duration``: of the pushes [s].
    """
    first = maps[0]
    count = len(maps) + 1
    title = f"{first.robot}: pushes of {duration:g} s survived without a step"
    figure = style.sheet(WIDTH * count, HEIGHT + LEGEND, title)
    wide = figure.get_size_inches()[0]
    size = (0.68 * WIDTH / wide, 0.68 * WIDTH / (HEIGHT + LEGEND))
    for k in range(count):
        place = ((k + 0.16) * WIDTH / wide, (LEGEND + 0.2) / (HEIGHT + LEGEND))
        axes: Any = figure.add_axes((*place, *size), projection="polar")
        if k < len(maps):
            one = maps[k]
            name = f"{style.literal(one.name)}: " if len(maps) > 1 else ""
            _style_polar(axes, f"{name}impulse / (M omega d)\n{_title_of(maps, k)}")
            _dots(axes, one)
            others: Others = [other for other in maps if other is not one]
            _lines(axes, one, lambda bounds: bounds.ankle, others)
        else:
            _style_polar(axes, "impulse [N s]\n ")
            _lines(axes, first, lambda bounds: np.ones_like(bounds.ankle), maps[1:])
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="lower center", ncols=4 if count > 2 else 3, fontsize=style.SMALL,
        frameon=False,
    )  # fmt: skip
    return figure


def _title_of(maps: Sequence[PushMap], k: int) -> str:
    one = maps[k]
    text = f"least {one.least:.2f}, mean {one.mean:.2f}"
    if k == 0 and len(maps) > 1:
        _, mean, _ = compare_maps(maps[0], maps[1])
        text += f"; {mean:.2f} x {style.literal(maps[1].name)}" if np.isfinite(mean) else ""
    return text


def _style_polar(axes: Any, title: str) -> None:
    """Give a polar plot its title and a faint grid; forwards is up, left is left."""
    axes.set_theta_zero_location("N")
    axes.set_title(title, fontsize=style.NORMAL, fontweight="bold", color=style.BLACK, pad=14.0)
    axes.set_thetagrids(np.degrees([angle for angle, _ in SIDES]), [name for _, name in SIDES])
    axes.tick_params(labelsize=style.SMALL, colors=style.BLACK)
    axes.grid(True, color="#E4E6EA", linewidth=0.6)
    axes.spines["polar"].set_color("#E4E6EA")
    axes.set_axisbelow(True)


def _closed(angles: Array, values: Array) -> tuple[Array, Array]:
    return np.append(angles, angles[0] + 2.0 * np.pi), np.append(values, values[0])


def _lines(axes: Any, one: PushMap, per: Callable[[PushBounds], Array], others: Others) -> None:
    """Draw limits and theoretical bounds, divided by ``per``."""
    around = one.outline
    theory = [
        ("M omega d (ankles, at once)", around.ankle, style.GREY, "--"),
        ("ankles, push of this duration", around.pulse, style.ORANGE, "-."),
    ]
    if around.wheel is not None:
        theory.append(("with a reaction mass (estimate)", around.wheel, style.GREEN, ":"))
    for label, impulses, colour, dashes in theory:
        line = _closed(around.angles, impulses / per(around))
        axes.plot(*line, dashes, color=colour, linewidth=1.3, label=label)
    angles, scale = one.grid.angles, 1.0 / per(one.bounds)
    limit = one.limits * one.bounds.ankle * scale
    axes.plot(*_closed(angles, limit), color=style.BLUE, linewidth=2.0, label="survived")
    axes.fill(angles, limit, color=style.BLUE, alpha=0.10)
    for other in others:
        line = _closed(other.grid.angles, other.limits * other.bounds.ankle * scale)
        axes.plot(*line, color=style.PURPLE, linewidth=1.5, label="survived by the other")
    axes.set_ylim(bottom=0.0)
    axes.yaxis.set_major_locator(MaxNLocator(RINGS, steps=(1, 2, 5, 10)))
    axes.tick_params(axis="y", labelsize=style.SMALL - 1.0, labelcolor=style.GREY)
    axes.set_rlabel_position(180.0 / one.grid.directions)  # between two directions


def _dots(axes: Any, one: PushMap) -> None:
    angles, ratios = np.meshgrid(one.grid.angles, np.asarray(one.grid.ratios), indexing="ij")
    for value, colour, marker, label in (
        (SURVIVED, style.BLUE, "o", "push survived"),
        (FELL, style.VERMILION, "x", "push not survived"),
    ):
        chosen = one.table == value
        axes.scatter(
            angles[chosen], ratios[chosen], s=DOT, c=colour, marker=marker, linewidths=0.9,
            label=label, zorder=3,
        )  # fmt: skip
