"""Plots that say what held a robot back: what was left of constraints, and which rows were active.

Rows are limits of joints, pairs of bodies, edges of the support and so on.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from wbc.motion.dropouts import runs
from wbc.validate import Array
from wbc.view import style
from wbc.view.series import Series, plot_curves, shortened

LINEAR = 1.0  # mm: nearer to zero the axis is linear, beyond it is logarithmic
MOST = 9  # rows shown, those that held back the longest
THICK = 0.62  # of a bar, part of a row
LONGEST = 34  # characters of a row's label


def plot_clearance(axes: Axes, time: Array, clearance: Mapping[str, Array]) -> None:
    """Draw what is left of each constraint; below zero it is violated."""
    style.plain(axes, "Left of the constraints", "time [s]", "distance [mm]")
    looks = cycle(style.SERIES)
    series = [
        Series(name, colour, "-", 1e3 * left)
        for (name, left), colour in zip(clearance.items(), looks, strict=False)
    ]
    axes.set_yscale("symlog", linthresh=LINEAR)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    seen = np.concatenate([one.values[np.isfinite(one.values)] for one in series])
    axes.set_ylim(min(-0.1, 1.5 * float(seen.min())), max(1.0, 1.5 * float(seen.max())))
    axes.axhline(0.0, color=style.VERMILION, linewidth=0.8)
    plot_curves(axes, time, series)


def plot_held_back(axes: Axes, time: Array, active: Mapping[str, NDArray[np.bool_]]) -> None:
    """Draw when each row held the robot back, those that did so the longest on top."""
    longest = sorted(active, key=lambda label: -int(np.count_nonzero(active[label])))
    shown = longest[:MOST]
    more = len(longest) - len(shown)
    title = "Held back by" + (f" (and {more} more)" if more else "")
    style.plain(axes, title, "time [s]", "")
    dt = float(time[1] - time[0]) if len(time) > 1 else 1.0
    for row, label in enumerate(shown):
        bars = [(float(time[a]), float(time[b - 1] - time[a] + dt)) for a, b in runs(active[label])]
        colour = style.SERIES[row % len(style.SERIES)]
        axes.broken_barh(bars, (row - 0.5 * THICK, THICK), color=colour, linewidth=0.0)
    axes.set_xlim(float(time[0]), float(time[-1]) + (dt if len(time) == 1 else 0.0))
    axes.set_ylim(max(len(shown), 3) - 0.5, -0.5)
    axes.set_yticks(range(len(shown)), [_brief(label) for label in shown])
    axes.tick_params(axis="y", labelsize=style.SMALL - 1.5, length=0)
    axes.grid(visible=False, axis="y")


def _brief(label: str) -> str:
    """Return a label without what robots' files hang on every name."""
    for ending in ("_link", "_joint"):
        label = label.replace(ending, "")
    return shortened(label, LONGEST)
