"""A recorded motion as a pendulum, in one figure: snapshots in a row, and plots over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wbc.constraints.com_support import support_polygon
from wbc.errors import InvalidInputError
from wbc.motion import RmpSeries
from wbc.rmp.ellipsoid import Ellipsoid
from wbc.validate import Array
from wbc.view import style
from wbc.view.analysis_plots import LETTERS, PLOTS
from wbc.view.portrait import Portrait, draw_pendulum, panels_of, portraits_of, shape_of
from wbc.view.scene import densified

WIDTH = 9.0  # inches
PANEL_SHAPE = (1.0, 1.9)  # height to width of a snapshot, at least and at most
HIGHEST = 2.8  # inches, of a snapshot
HEADING, CAPTION = 0.58, 0.55  # inches, above and below the snapshots
ROW, TIME = 1.87, 0.20  # inches, of a row of plots and of the times below all
COLUMNS = 2
RADIUS_WIDTH = 0.44  # inches, of a radius as written below a picture
FULL_SIZE = 0.39  # inches that a radius needs for full size
MARKS, LINES = 0.7, (1.4, 0.9)  # size of the pendulum; widths of outlines [points]
TINY, TINIEST = 6.5, 5.0  # points, of the radii, where there is room and where there is not
EXPLANATION = (
    "equimomental ellipsoid with reaction masses at radii r [mm], leg from the CoP to the CoM,"
    " support polygon"
)
BANDS = "; shaded: 95 % bands of the recording's noise"
MOST_SNAPSHOTS = len(LETTERS)

Snapshots = int | Sequence[float]  # how many, or at which times [s]


def analysis_figure(series: RmpSeries, *, title: str, snapshots: Snapshots = 6) -> Figure:
    """Return a figure of a motion's pendulum: snapshots, ground, radii, leg and rotation.

    ``title``: written above all.
    ``snapshots``: how many, evenly spread over the motion; or their times [s]. 1 to 10.

    Raises InvalidInputError: another number of snapshots, or times outside the motion; ModelError:
    the robot's meshes cannot be read.
    """
    frames = snapshot_frames(series.time, snapshots)
    told = EXPLANATION + (BANDS if series.uncertainty else "")
    figure, grid = sheet_with_snapshots(series, frames, title, told, -(-len(PLOTS) // COLUMNS))
    for axes, draw in zip(grid, PLOTS, strict=True):
        draw(axes, series, frames)
    return figure


def sheet_with_snapshots(
    series: RmpSeries, frames: Sequence[int], title: str, told: str, rows: int
) -> tuple[Figure, list[Axes]]:
    """Return a figure that begins with snapshots of some frames, and axes in rows of 2 below.

    ``told`` is written between them.
    """
    portraits = snapshot_portraits(series, frames)
    wide = WIDTH / max(len(portraits), 4)  # fewer are not drawn larger than a quarter
    high = min(HIGHEST, wide * float(np.clip(shape_of(portraits), *PANEL_SHAPE)))
    below = rows * ROW + TIME
    total = HEADING + high + CAPTION + below
    figure = style.sheet(WIDTH, total, title, below)
    left, bottom = 0.5 * (WIDTH - wide * len(portraits)), below + CAPTION
    places = [left + wide * k for k in range(len(portraits))]
    draw_snapshots([style.place(figure, x, bottom, wide, high) for x in places], portraits)
    figure.text(
        0.5, (bottom - 0.30) / total, told,
        ha="center", va="top", fontsize=7.0, color=style.GREY,
    )  # fmt: skip
    return figure, list(figure.subplots(rows, COLUMNS).flat)


def check_snapshots(snapshots: Snapshots) -> None:
    """Raise InvalidInputError unless they are 1 to 10."""
    count = snapshots if isinstance(snapshots, int) else len(snapshots)
    if not 1 <= count <= MOST_SNAPSHOTS:
        raise InvalidInputError(f"snapshots: from 1 to {MOST_SNAPSHOTS}, got {count}")


def snapshot_frames(time: Array, snapshots: Snapshots) -> list[int]:
    """Return the frames to draw: evenly spread over all, or those nearest to the times given."""
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


# ---------------------------------------------------------------------- snapshots


def snapshot_portraits(series: RmpSeries, frames: Sequence[int]) -> list[Portrait]:
    """Return some frames of a motion, ready to be drawn."""
    names = {
        f"{letter})  {series.time[frame]:.2f} s": series.q[frame]
        for letter, frame in zip(LETTERS, frames, strict=False)
    }
    portraits = portraits_of(series.robot, names)
    return [_with_motion(one, series, k) for one, k in zip(portraits, frames, strict=True)]


def _with_motion(portrait: Portrait, series: RmpSeries, frame: int) -> Portrait:
    """Return a portrait with the pendulum of a frame: its CoP, axes and support polygon."""
    # The tracked axes, so that an axis has one colour in all pictures and plots.
    ellipsoid = Ellipsoid(series.semi_axes[frame], series.axes[frame], series.robot.mass)
    scene = replace(portrait.scene, ellipsoid=ellipsoid, ground=series.ground_height)
    outlines = []
    stands = series.standing[frame]
    if stands.any():
        feet = [name for name, on in zip(series.feet, stands, strict=True) if on]
        corners = support_polygon(portrait.snapshot, feet)
        closed = np.concatenate((corners, corners[:1]))
        ground = np.full(len(closed), series.ground_height)
        outlines.append(densified(np.column_stack((closed, ground))))
    cop = None if series.flight[frame] else series.cop[frame]
    radii = series.radii[frame]
    return replace(portrait, scene=scene, outlines=outlines, foot=cop, radii=radii)


def draw_snapshots(all_axes: Sequence[Axes], portraits: Sequence[Portrait]) -> None:
    """Draw each portrait on axes of its own, with the masses' radii below it."""
    for panel, portrait in zip(panels_of(all_axes, portraits), portraits, strict=True):
        draw_pendulum(panel, portrait, MARKS, LINES)
        panel.axes.set_title(portrait.name, fontsize=style.SMALL, color=style.BLACK, pad=3)
        width = panel.camera.width / style.DPI  # inches
        # Closer to each other than to those of the next picture.
        apart = min(RADIUS_WIDTH / width, 0.31)
        size = max(TINIEST, TINY * min(1.0, apart * width / FULL_SIZE))
        texts = [f"r{style.INDEX[k]} {1e3 * r:.0f}" for k, r in enumerate(portrait.radii)]
        style.write_below(panel.axes, texts, apart, size)
