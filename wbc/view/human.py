"""A human's recording as a pendulum, with what force plates measured beside it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wbc.human import Comparison
from wbc.motion import RmpSeries
from wbc.view import style
from wbc.view.analysis import Snapshots, sheet_with_snapshots, snapshot_frames
from wbc.view.analysis_plots import MM, XYZ, band, curve, legend, plot_radii, plot_rotation, prepare

EXPLANATION = (
    "equimomental ellipsoid with reaction masses at radii r [mm], leg from the CoP to the CoM;"
    " shaded: 95 % bands"
)
DOTTED = "; dotted: force plates, at the same low-pass"
DOTS = (0, (1, 1))
EDGE = 12  # part of the frames at each end that does not set the limits of a plot


def human_figure(
    series: RmpSeries, plates: Comparison | None, *, title: str, snapshots: Snapshots = 6
) -> Figure:
    """Return a figure of a human's pendulum: ground force, CoP, angular momentum, radii, rotation.

    ``plates`` is the series against force plates, or None; for the rest and errors see
    :func:`wbc.view.analysis.analysis_figure`.
    """
    frames = snapshot_frames(series.time, snapshots)
    told = EXPLANATION + (DOTTED if plates else "")
    figure, grid = sheet_with_snapshots(series, frames, title, told, 3)
    _force(grid[0], series, plates, frames)
    _cop(grid[1], series, plates, frames)
    _momentum(grid[2], series, frames)
    _heights(grid[3], series, frames)
    plot_radii(grid[4], series, frames)
    plot_rotation(grid[5], series, frames)
    return figure


def _force(axes: Axes, series: RmpSeries, plates: Comparison | None, frames: Sequence[int]) -> None:
    prepare(axes, series, frames, "Ground force by the weight", "")
    weight = series.robot.weight
    for k, colour in enumerate(XYZ):
        values = series.ground_force[:, k] / weight
        band(axes, series, "momentum_rate", 1.0 / weight, colour, k, values)
        curve(axes, series, values, "xyz"[k], colour)
        if plates is not None:
            axes.plot(plates.time, plates.force[:, k] / weight, linestyle=DOTS, color=style.BLACK)
    legend(axes)


def _cop(axes: Axes, series: RmpSeries, plates: Comparison | None, frames: Sequence[int]) -> None:
    prepare(axes, series, frames, "CoP from the CoM", "mm")
    for k, colour in enumerate(XYZ[:2]):
        values = MM * (series.cop[:, k] - series.com[:, k])
        band(axes, series, "cop", MM, colour, k, values)
        curve(axes, series, values, "xy"[k], colour)
        if plates is not None:
            com = np.interp(plates.time, series.time, series.com[:, k])
            off = MM * (plates.cop[:, k] - com)
            axes.plot(plates.time, off, linestyle=DOTS, color=style.BLACK)
    # Near the ends, where accelerations are guesses, it may be anywhere.
    inner = slice(len(series) // EDGE, len(series) - len(series) // EDGE)
    off = MM * (series.cop[inner, :2] - series.com[inner, :2])
    if np.isfinite(off).any():
        low, high = float(np.nanmin(off)), float(np.nanmax(off))
        room = 0.15 * (high - low) + 10.0
        axes.set_ylim(low - room, high + room)
    legend(axes)


def _momentum(axes: Axes, series: RmpSeries, frames: Sequence[int]) -> None:
    prepare(axes, series, frames, "Angular momentum by M h √(g h)", "")
    scale = momentum_scale(series)
    for k, colour in enumerate(XYZ):
        curve(axes, series, series.momentum[:, 3 + k] / scale, "xyz"[k], colour)
    legend(axes)


def momentum_scale(series: RmpSeries) -> float:
    """Return M h (g h)^(1/2) [kg m^2/s], h the CoM's mean height over the ground."""
    height = float(series.com[:, 2].mean()) - series.ground_height
    return series.robot.mass * height * float(np.sqrt(series.robot.gravity * height))


def _heights(axes: Axes, series: RmpSeries, frames: Sequence[int]) -> None:
    prepare(axes, series, frames, "CoM, from its mean", "mm")
    for k, name in ((2, "height"), (1, "left")):
        values = MM * (series.com[:, k] - series.com[:, k].mean())
        curve(axes, series, values, name, XYZ[k])
    legend(axes)
