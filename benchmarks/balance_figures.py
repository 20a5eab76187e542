"""Figures of a pendulum's balance: pushes survived all around, and starts brought to rest."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from wbc.validate import Array
from wbc.view import style

SIDE, HIGH = 3.4, 3.35  # inches


def pushes_figure(directions: Array, impulses: Mapping[str, Array]) -> Figure:
    """Return a polar plot of impulses by direction.

    Parameters
    ----------
    directions:
        (n, 2), of any length but zero, in order around.
    impulses:
        Sizes (n,) [N s] by what they are; the last is drawn with markers.

    """
    angle = np.arctan2(directions[:, 1], directions[:, 0])
    figure = style.sheet(1.25 * SIDE, 1.45 * SIDE)
    axes: Any = figure.add_axes((0.12, 0.23, 0.76, 0.64), projection="polar")
    closed = np.append(angle, angle[:1])
    names = list(impulses)
    for name, colour in zip(names, cycle(style.SERIES), strict=False):
        size = impulses[name]
        look = {"marker": "o", "markersize": 3.5} if name == names[-1] else {}
        axes.plot(
            closed, np.append(size, size[:1]), color=colour, linewidth=1.4, label=name, **look
        )
    axes.set_rlabel_position(100)
    axes.tick_params(labelsize=style.SMALL, colors=style.BLACK)
    axes.grid(color="#E4E6EA", linewidth=0.6)
    axes.set_title("Impulse [N s] by direction", fontsize=style.NORMAL, color=style.BLACK, pad=12)
    axes.legend(
        loc="upper center", bbox_to_anchor=(0.5, -0.12), fontsize=style.SMALL, frameon=False
    )
    return figure


def regions_figure(x_leans: Array, y_leans: Array, settling: Mapping[str, Array]) -> Figure:
    """Return maps of how long a law takes to bring a leaning pendulum to rest.

    Parameters
    ----------
    x_leans, y_leans:
        Starts' leans toward x (n,) and y (m,) [rad], growing in even steps.
    settling:
        Times [s] (n, m) by law; NaN where it fell.
    """
    x, y, count = np.degrees(x_leans), np.degrees(y_leans), len(settling)
    reached = [float(np.nanmax(times)) for times in settling.values() if np.isfinite(times).any()]
    longest = max(reached, default=1.0)
    figure = style.sheet(1.2 + count * (SIDE - 0.4), HIGH, plots=HIGH)
    row = figure.subplots(1, count, squeeze=False)[0]
    half = [(axis[1] - axis[0]) / 2 for axis in (x, y)]
    extent = (x[0] - half[0], x[-1] + half[0], y[0] - half[1], y[-1] + half[1])
    drawn: Any = None
    for k, (axes, (name, times)) in enumerate(zip(row, settling.items(), strict=True)):
        style.plain(axes, name, "lean toward x [°]", "lean toward y [°]" if k == 0 else "")
        axes.set_facecolor("#D9DBDF")
        drawn = axes.imshow(
            times.T, origin="lower", extent=extent, vmin=0.0, vmax=longest, cmap="viridis_r",
            aspect="auto", interpolation="nearest",
        )  # fmt: skip
        axes.grid(visible=False)
    bar = figure.colorbar(drawn, ax=row, fraction=0.15 / count, pad=0.02)
    bar.set_label("time to rest [s]; grey: fell", fontsize=style.SMALL, color=style.BLACK)
    bar.ax.tick_params(labelsize=style.SMALL, colors=style.BLACK)
    return figure
