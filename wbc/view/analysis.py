"""A recorded motion as a pendulum, in one figure: snapshots in a row, and plots over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from wbc.errors import InvalidInputError
from wbc.motion import RmpSeries
from wbc.validate import Array
from wbc.view import style
from wbc.view.analysis_plots import LETTERS, PLOTS
from wbc.view.analysis_strip import Moment, draw_moments, moments_of, shape_of_moments
from wbc.view.files import picture_file, save

WIDTH = 9.0  # inches
PANEL_SHAPE = (1.0, 1.9)  # height to width of a snapshot, at least and at most
HEADING, NAMES, CAPTION = 0.36, 0.22, 0.72  # inches, from the top
HIGHEST = 2.8  # inches, of a snapshot
COLUMNS = 2
PLOT, APART, BELOW = 1.35, 0.5, 0.5  # inches
LEFT, BETWEEN, RIGHT = 0.66, 1.24, 0.30  # inches
MOST = len(LETTERS)

Snapshots = int | Sequence[float]  # how many, or at which times [s]


def plot_analysis(
    series: RmpSeries, path: str | Path, *, title: str, snapshots: Snapshots = 6
) -> Path:
    """Draw a motion's reaction mass pendulum: snapshots, ground, radii, leg and rotation.

    Parameters
    ----------
    path:
        The file: png, svg or pdf by its suffix.
    title:
        Written above all.
    snapshots:
        How many, evenly spread over the motion; or their times [s]. 1 to 10.

    Returns
    -------
    The file.

    Raises
    ------
    InvalidInputError
        Another suffix, no such folder, another number of snapshots, or times outside the motion.
    ModelError
        The robot's meshes cannot be read.
    """
    path = picture_file(path)
    save(analysis_figure(series, title=title, snapshots=snapshots), path)
    return path


def analysis_figure(series: RmpSeries, *, title: str, snapshots: Snapshots = 6) -> Figure:
    """Return the figure that :func:`plot_analysis` writes."""
    frames = snapshot_frames(series.time, snapshots)
    moments = moments_of(series, frames)
    wide = WIDTH / max(len(moments), 4)  # fewer are not drawn larger than a quarter
    high = min(HIGHEST, wide * float(np.clip(shape_of_moments(moments), *PANEL_SHAPE)))
    rows = -(-len(PLOTS) // COLUMNS)
    total = HEADING + NAMES + high + CAPTION + rows * (PLOT + APART) + BELOW - APART
    figure = Figure(figsize=(WIDTH, total), dpi=style.DPI, facecolor="white")
    style.heading(figure, title, 1.0 - 0.1 / total)
    _draw_strip(figure, moments, wide, high, 1.0 - (HEADING + NAMES + high) / total)
    top = total - HEADING - NAMES - high - CAPTION  # inches
    plot_width = (WIDTH - LEFT - RIGHT - (COLUMNS - 1) * BETWEEN) / COLUMNS
    for k, draw in enumerate(PLOTS):
        row, column = divmod(k, COLUMNS)
        left = LEFT + column * (plot_width + BETWEEN)
        bottom = top - PLOT - row * (PLOT + APART)
        axes = figure.add_axes((left / WIDTH, bottom / total, plot_width / WIDTH, PLOT / total))
        draw(axes, series, frames, row == rows - 1)
    return figure


def check_snapshots(snapshots: Snapshots) -> None:
    """Raise InvalidInputError unless they are 1 to 10."""
    count = snapshots if isinstance(snapshots, int) else len(snapshots)
    if not 1 <= count <= MOST:
        raise InvalidInputError(f"snapshots: from 1 to {MOST}, got {count}")


def snapshot_frames(time: Array, snapshots: Snapshots) -> list[int]:
    """Return the frames to draw: evenly spread over all, or those nearest to the times given.

    Raises
    ------
    InvalidInputError
        Not 1 to 10, or a time outside the motion.
    """
    check_snapshots(snapshots)
    if isinstance(snapshots, int):
        frames = np.linspace(0, len(time) - 1, snapshots).round().astype(int)
        return np.unique(frames).tolist()
    for at in snapshots:
        if not time[0] <= at <= time[-1]:
            raise InvalidInputError(
                f"snapshots: the motion is from {time[0]:.6g} s to {time[-1]:.6g} s, got {at:g} s"
            )
    return sorted({int(np.abs(time - at).argmin()) for at in snapshots})


def _draw_strip(
    figure: Figure, moments: list[Moment], wide: float, high: float, bottom: float
) -> None:
    total = float(figure.get_size_inches()[1])
    margin = 0.5 * (WIDTH - wide * len(moments))  # inches
    panels = [
        figure.add_axes(((margin + wide * k) / WIDTH, bottom, wide / WIDTH, high / total))
        for k in range(len(moments))
    ]
    draw_moments(panels, moments, (wide, high))
    caption = (
        "equimomental ellipsoid with reaction masses at radii r [mm], leg from the CoP to the CoM,"
        " support polygon"
    )
    figure.text(
        0.5, bottom - 0.30 / total, caption, ha="center", va="top", fontsize=7.0, color=style.GREY
    )
