"""The plots over time of a motion's pendulum: ground, support, radii, leg and rotation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes

from wbc.motion import RmpSeries
from wbc.motion.dropouts import runs
from wbc.motion.uncertainty import BAND
from wbc.validate import Array
from wbc.view import style

LETTERS = "abcdefghij"  # of the snapshots
MM, DEGREES = 1e3, 180.0 / np.pi
WIDTH = 1.3  # points, of a curve
FLIGHT = "#EEF0F3"
SHADE = 0.22  # of a band
# Axes are as long at least: rounding would fill those of a robot that stands still.
LEAST_MM, LEAST_DEGREES, LEAST_RATE = 2.0, 0.2, 0.02  # rate: rad/s
XYZ = (style.BLUE, style.VERMILION, style.GREEN)

Plot = Callable[[Axes, RmpSeries, Sequence[int]], None]


def plot_ground(axes: Axes, series: RmpSeries, frames: Sequence[int], k: int) -> None:
    """Plot CoM, CoP and CMP along a horizontal axis of the world: x (k = 0) or y (1)."""
    prepare(axes, series, frames, f"Ground, along {'xy'[k]} of the world", "mm")
    for name, label, colour in (
        ("com", "CoM", style.BLACK),
        ("cmp", "CMP", style.ORANGE),
        ("cop", "CoP", style.BLUE),
    ):
        if name != "cmp":  # as wide as that of the CoP, which it would hide
            band(axes, series, name, MM, colour, k)
        curve(axes, series, MM * getattr(series, name)[:, k], label, colour)
    least_span(axes, LEAST_MM)
    legend(axes)


def plot_margin(axes: Axes, series: RmpSeries, frames: Sequence[int]) -> None:
    """Plot how far the CoP is inside the support polygon.

    Filled where the motion is infeasible: where it is outside by more than noise can do.
    """
    prepare(axes, series, frames, "CoP inside the support polygon by", "mm")
    if series.cop_margin is None or np.isnan(series.cop_margin).all():
        why = "no feet to judge by" if series.cop_margin is None else "no foot stands"
        axes.text(
            0.5, 0.5, f"{why}: the CoP is not judged", transform=axes.transAxes,
            ha="center", va="center", fontsize=style.SMALL, color=style.GREY,
        )  # fmt: skip
        axes.set_yticks([])
        return
    margin = MM * series.cop_margin
    half = band(axes, series, "cop_margin", MM, style.BLUE)
    curve(axes, series, margin, "margin", style.BLUE)
    axes.axhline(0.0, color=style.VERMILION, linewidth=0.9)
    axes.fill_between(
        series.time, margin, 0.0, where=series.infeasible, color=style.VERMILION, alpha=0.35,
        linewidth=0.0,
    )  # fmt: skip
    low, high = np.nanmin([*(margin - half), 0.0]), np.nanmax([*(margin + half), 0.0])
    room = 0.08 * (high - low or 1.0)
    axes.set_ylim(low - room, high + room)


def plot_radii(axes: Axes, series: RmpSeries, frames: Sequence[int]) -> None:
    """Plot the reaction masses' radii; thin and dashed where the axis is undefined."""
    prepare(axes, series, frames, "Reaction mass radii", "mm")
    for k, colour in enumerate(style.PRINCIPAL):
        radius, defined = MM * series.radii[:, k], series.axes_defined[:, k]
        if not defined.all():
            axes.plot(series.time, radius, color=colour, linewidth=0.7, linestyle=":")
        label = f"r{style.INDEX[k]}"
        band(axes, series, "radii", MM, colour, k)
        curve(axes, series, np.where(defined, radius, np.nan), label, colour)
    axes.set_ylim(0.0, 1.08 * MM * float(series.radii.max()))
    legend(axes)


def plot_leg(axes: Axes, series: RmpSeries, frames: Sequence[int]) -> None:
    """Plot the leg's lean from the vertical, to x and to y, and its length on the right."""
    prepare(axes, series, frames, "Leg from CoP to CoM", "lean [deg]")
    lean = DEGREES * (series.leg_angles - [0.5 * np.pi, 0.0])
    # Theta turns the leg from x to z: what leans to x has a theta below 90 degrees.
    for k, colour in enumerate((style.BLUE, style.VERMILION)):
        band(axes, series, "leg_angles", DEGREES, colour, k, (-1.0, 1.0)[k] * lean[:, k])
    curve(axes, series, -lean[:, 0], "to x", style.BLUE)
    curve(axes, series, lean[:, 1], "to y", style.VERMILION)
    other = style.right_axis(axes, "length [mm]", style.GREY)
    length = MM * series.leg_length
    other.plot(series.time, length, "--", color=style.GREY, linewidth=WIDTH, label="length")
    least_span(axes, LEAST_DEGREES)
    least_span(other, LEAST_MM)
    legend(axes, other)


def plot_rotation(axes: Axes, series: RmpSeries, frames: Sequence[int]) -> None:
    """Plot the momentum's average angular velocity against that of the principal axes."""
    prepare(axes, series, frames, "Rotation", "rad/s")
    for k, colour in enumerate(XYZ):
        band(axes, series, "average_angular_velocity", 1.0, colour, k)
        curve(axes, series, series.average_angular_velocity[:, k], "xyz"[k], colour)
        curve(axes, series, series.axes_angular_velocity[:, k], None, colour, "--")
    axes.plot([], [], color=style.BLACK, linewidth=WIDTH, label="I⁻¹k")
    axes.plot([], [], color=style.BLACK, linewidth=WIDTH, linestyle="--", label="axes")
    least_span(axes, LEAST_RATE)
    legend(axes)


PLOTS: tuple[Plot, ...] = (
    partial(plot_ground, k=0),
    partial(plot_ground, k=1),
    plot_margin,
    plot_radii,
    plot_leg,
    plot_rotation,
)


# ---------------------------------------------------------------------- shared by all


def prepare(axes: Axes, series: RmpSeries, frames: Sequence[int], title: str, unit: str) -> None:
    """Give a plot its look, the moments of the snapshots, and a ground where the robot flies."""
    place = axes.get_subplotspec()
    lowest = place is None or place.is_last_row()
    style.plain(axes, title, "time [s]" if lowest else "", unit)
    axes.set_xlim(series.time[0], series.time[-1])
    if not lowest:
        axes.tick_params(labelbottom=False)
    for letter, frame in zip(LETTERS, frames, strict=False):
        at = float(series.time[frame])
        axes.axvline(at, color=style.GREY, linewidth=0.5, linestyle=(0, (1, 2)))
        if not lowest:  # there, the numbers of the time axis are in the way
            axes.annotate(
                letter, (at, 0.0), xycoords=axes.get_xaxis_transform(), xytext=(0.0, -4.0),
                textcoords="offset points", ha="center", va="top", fontsize=6.5, color=style.GREY,
            )  # fmt: skip
    for start, end in runs(series.flight):
        axes.axvspan(
            series.time[start], series.time[end - 1], color=FLIGHT, linewidth=0.0, zorder=0
        )


def curve(
    axes: Axes, series: RmpSeries, values: Array, label: str | None, colour: str, dashes: str = "-"
) -> None:
    """Plot values over time; a single frame as a dot."""
    marker = "o" if len(series) == 1 else None
    axes.plot(
        series.time, values, dashes, label=label, color=colour, linewidth=WIDTH, marker=marker
    )


def band(
    axes: Axes,
    series: RmpSeries,
    name: str,
    scale: float,
    colour: str,
    k: int | None = None,
    values: Array | None = None,
) -> Array:
    """Shade the 95 % band of a quantity's noise, and return half its width (n,); 0: none known.

    ``k`` is the quantity's column; it is drawn around ``values``, by default the series' own.
    """
    deviation = None if series.uncertainty is None else getattr(series.uncertainty, name)
    if deviation is None or np.isnan(deviation).all():
        return np.zeros(len(series))
    column = slice(None) if k is None else (slice(None), k)
    half = BAND * scale * deviation[column]
    middle = scale * getattr(series, name)[column] if values is None else values
    axes.fill_between(
        series.time, middle - half, middle + half, color=colour, alpha=SHADE, linewidth=0.0
    )
    return np.asarray(np.nan_to_num(half))


def least_span(axes: Axes, span: float) -> None:
    """Let the vertical axis of what is drawn be as long at least."""
    low, high = axes.get_ylim()
    if high - low < span:
        middle = 0.5 * (low + high)
        axes.set_ylim(middle - 0.5 * span, middle + 0.5 * span)


def legend(axes: Axes, other: Axes | None = None) -> None:
    """Write what the curves are on the title's line, at its right end."""
    handles, labels = axes.get_legend_handles_labels()
    if other is not None:
        more = other.get_legend_handles_labels()
        handles, labels = handles + more[0], labels + more[1]
    axes.legend(
        handles, labels, loc="lower right", bbox_to_anchor=(1.02, 0.985), ncols=len(labels),
        fontsize=7.0, frameon=False, handlelength=1.4, handletextpad=0.4, columnspacing=0.9,
        borderaxespad=0.0,
    )  # fmt: skip
