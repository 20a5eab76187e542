"""A pendulum's motion in one figure: a strip of ellipsoids on their legs, and plots below."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from numpy.typing import NDArray

from wbc.problem.pendulum.result import PendulumHistory
from wbc.validate import Array
from wbc.view import style
from wbc.view.pendulum_plots import HEIGHT, SOLID, STATIONARY, plots_of, view_side
from wbc.view.pendulum_plots import WIDTH as PLOT_WIDTH

WIDTH = 9.2  # inches
BETWEEN, HEADING, BELOW = 0.85, 0.45, 0.5  # inches
STRIP_WIDTH = 8.2  # inches
STRIP_HEIGHT = (0.9, 3.4)  # inches, at least and at most
FIRST, GAP = 0.78, 0.76  # inches, along the row of plots
SNAPSHOTS = 9
SPACING = 0.15  # of the gap between two snapshots, in widths of one
LEAST_SPACING = 0.75  # of the distance of two snapshots, in mean distances: their times need room
SLENDER_SPACING = 0.18  # of that distance at least, in heights of a strip that is high and narrow
TRAVEL_SHARE = 0.6  # a motion that covers this much of the strip is drawn where it happened
TIME_SHARE = 0.3  # part of the snapshots' spacing that is even in time, not in what moves
Point = tuple[float, float]


def plot_pendulum(history: PendulumHistory, path: str | Path, title: str = "") -> None:
    """Draw a pendulum's motion into a file; see :func:`pendulum_figure`.

    Raises
    ------
    InvalidInputError
        A file type that cannot be drawn.
    """
    style.save(pendulum_figure(history, title), path)


def pendulum_figure(history: PendulumHistory, title: str = "") -> Figure:
    """Return a figure of a pendulum's motion.

    Above, the masses' equimomental ellipsoid and the leg at even times, seen from the side on which
    most happens. Below, a phase portrait (leg's angle, or height where the foot moves or leaves the
    ground; of a pendulum that only spins, how fast its masses turn), CoM, CoP and CMP on the ground
    with the support polygons, and the angular momentum with the masses' distances.
    """
    strip = Figure().add_axes((0.0, 0.0, 1.0, 1.0))
    draw_strip(strip, history)
    (left, right), (low, high) = strip.get_xlim(), strip.get_ylim()
    tall = float(np.clip(STRIP_WIDTH * (high - low) / (right - left), *STRIP_HEIGHT))
    height = HEADING + tall + BETWEEN + HEIGHT + BELOW
    figure = style.sheet(WIDTH, height, title)
    left, bottom = (WIDTH - STRIP_WIDTH) / 2, BELOW + HEIGHT + BETWEEN
    draw_strip(style.place(figure, left, bottom, STRIP_WIDTH, tall), history)
    for k, draw in enumerate(plots_of(history)):
        left = FIRST + k * (PLOT_WIDTH + GAP)
        draw(style.place(figure, left, BELOW, PLOT_WIDTH, HEIGHT), history)
    return figure


# ---------------------------------------------------------------------- strip


def draw_strip(axes: Axes, history: PendulumHistory) -> None:
    """Draw snapshots side by side, or where they were if the pendulum travels."""
    chosen = _snapshot_rows(history)
    side = view_side(history)
    along = history.com @ side
    last = max(len(chosen) - 1, 1)
    places = _snapshot_positions(history, chosen, side)
    travels = float(np.ptp(along)) > TRAVEL_SHARE * float(places[-1] - places[0])
    for number, (place, k) in enumerate(zip(places.tolist(), chosen.tolist(), strict=True)):
        shift = 0.0 if travels else place - float(_origin(history, k) @ side)
        draw_snapshot(axes, history, k, side, shift, faint=0.35 + 0.65 * number / last)
    axes.axhline(0.0, color=style.GREY, linewidth=0.9, zorder=0)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_yticks([])
    if travels:
        axes.tick_params(labelsize=style.SMALL, colors=style.BLACK, width=0.6, length=3)
        axes.set_xlabel("along the ground [m]", fontsize=style.SMALL, color=style.BLACK)
    else:
        spans = [_extent(history, k, side) for k in chosen.tolist()]
        axes.set_xticks(places + np.mean(spans, axis=1))
        axes.set_xticklabels([_time_label(history, k, side) for k in chosen], fontsize=style.SMALL)
        axes.tick_params(length=0, colors=style.BLACK)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _snapshot_rows(history: PendulumHistory) -> NDArray[np.intp]:
    """Return the rows of the snapshots, spread over the motion more than over time."""
    turned = np.einsum("nji,njk->nik", history.axes[:-1], history.axes[1:])
    angle = np.arccos(np.clip((np.trace(turned, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0))
    slid = np.abs(np.diff(history.radii, axis=0)).sum(axis=1)
    moved = np.linalg.norm(np.diff(history.com, axis=0), axis=1) + slid
    way = np.append(0.0, np.cumsum(moved + history.radii[1:].max(axis=1) * angle))
    share = way / max(float(way[-1]), 1e-12)
    even_size = history.time / max(float(history.time[-1]), 1e-12)
    measure = TIME_SHARE * even_size + (1.0 - TIME_SHARE) * share
    wanted = np.linspace(measure[0], measure[-1], SNAPSHOTS)
    return np.unique(np.searchsorted(measure, wanted).clip(0, len(measure) - 1))


def _origin(history: PendulumHistory, k: int) -> Array:
    """Return the centre of a snapshot: the foot, or the CoM in flight."""
    foot: Array = history.foot[k]
    return history.com[k] if np.isnan(foot).any() else foot


def _snapshot_positions(history: PendulumHistory, chosen: NDArray[np.intp], side: Array) -> Array:
    """Return the drawn origin of each snapshot, with equal gaps between snapshots."""
    spans = np.array([_extent(history, k, side) for k in chosen.tolist()])
    gap = SPACING * float(np.median(spans[:, 1] - spans[:, 0]))
    middles = spans.mean(axis=1)
    apart = spans[:-1, 1] - spans[1:, 0] + np.diff(middles) + gap
    whole = float(np.diff(spans, axis=1).sum()) + gap * len(spans)
    high = float(np.abs(history.com[chosen, 2]).max())
    apart = np.maximum(apart, max(LEAST_SPACING * whole / len(spans), SLENDER_SPACING * high))
    return np.concatenate(([0.0], np.cumsum(apart))) - middles


def _extent(history: PendulumHistory, k: int, side: Array) -> Point:
    """Return how far a drawn snapshot extends to either side of its origin."""
    shape = history.radii[k] if history.flat else SOLID * history.radii[k]
    turned = side @ history.axes[k]
    half = float(shape[0] if history.flat else np.linalg.norm(turned * shape))
    com = float((history.com[k] - _origin(history, k)) @ side)
    return min(0.0, com - half), max(0.0, com + half)


def _time_label(history: PendulumHistory, k: int, side: Array) -> str:
    """Return the time of a snapshot, and where its foot is if feet move."""
    text = f"{round(float(history.time[k]), 2):g} s"
    feet = history.foot @ side
    if np.nanmax(feet, initial=-np.inf) - np.nanmin(feet, initial=np.inf) < STATIONARY:
        return text
    place = round(float(feet[k]), 2) + 0.0  # never -0.00
    where = "in the air" if np.isnan(place) else f"at {place:.2f} m"
    return f"{text}\n{where}"


def draw_snapshot(
    axes: Axes,
    history: PendulumHistory,
    k: int,
    side: Array,
    shift: float = 0.0,
    faint: float = 1.0,
) -> None:
    """Draw leg, ellipsoid and masses of a row as seen along ``side`` (3,), moved by ``shift``."""

    def seen(point: Array) -> Point:
        return float(point @ side) + shift, float(point[2])

    com, foot = history.com[k], history.foot[k]
    if not np.isnan(foot).any():
        (x0, z0), (x1, z1) = seen(foot), seen(com)
        axes.plot((x0, x1), (z0, z1), color=style.BLACK, linewidth=1.6, alpha=faint, zorder=2)
        axes.plot(x0, z0, marker="o", markersize=3, color=style.BLACK, alpha=faint, zorder=3)
    shape, turn = SOLID * history.radii[k], history.axes[k]
    if history.flat:
        _wheel(axes, seen(com), shape[0] / SOLID, turn[:, 0] @ side, turn[2, 0], faint)
    else:
        _shadow(axes, seen(com), shape, np.array((side @ turn, turn[2])), faint)
        for j, colour in enumerate(style.PRINCIPAL):
            tips = [seen(com + sign * history.radii[k, j] * turn[:, j]) for sign in (-1.0, 1.0)]
            x, z = zip(*tips, strict=True)
            axes.plot(x, z, color=colour, linewidth=0.8, marker="o", markersize=2.5, alpha=faint)


def _wheel(axes: Axes, centre: Point, r: float, dx: float, dz: float, faint: float) -> None:
    _ellipse(axes, centre, (2 * r, 2 * r), 0.0, 0.25, faint)
    x = (centre[0] - r * dx, centre[0] + r * dx)
    z = (centre[1] - r * dz, centre[1] + r * dz)
    axes.plot(x, z, color=style.VERMILION, linewidth=1.0, marker="o", markersize=4.0, alpha=faint)


def _shadow(axes: Axes, centre: Point, shape: Array, view: Array, faint: float) -> None:
    """Draw the outline of an ellipsoid with semi-axes ``shape`` as seen by ``view`` (2, 3)."""
    squares, directions = np.linalg.eigh((view * shape**2) @ view.T)
    a, b = np.sqrt(np.maximum(squares[::-1], 0.0)).tolist()
    angle = float(np.degrees(np.arctan2(directions[1, 1], directions[0, 1])))
    _ellipse(axes, centre, (2 * a, 2 * b), angle, 0.28, faint)


def _ellipse(
    axes: Axes, centre: Point, size: Point, angle: float, fill: float, faint: float
) -> None:
    inside: dict[str, Any] = {"facecolor": style.TINT, "edgecolor": "none", "alpha": fill * faint}
    edge = {"facecolor": "none", "edgecolor": style.TINT, "alpha": faint}
    for look in (inside, edge):
        axes.add_patch(Ellipse(centre, *size, angle=angle, linewidth=1.0, **look))
