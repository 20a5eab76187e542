"""A pendulum's motion in one figure: a strip of ellipsoids on their legs, and plots below."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Polygon
from numpy.typing import NDArray

from wbc.problem.pendulum.history import PendulumHistory
from wbc.validate import Array
from wbc.view import style
from wbc.view.files import picture_file, save

WIDTH = 9.0  # inches
PLOTS, BETWEEN, HEADING, BELOW = 2.2, 0.85, 0.45, 0.5  # inches
STRIP_WIDTH = 8.2  # inches
STRIP_HEIGHT = (0.9, 3.4)  # inches, at least and at most
FIRST, PLOT_WIDTH, GAP = 0.7, 2.05, 0.72  # inches, along the row of plots
STILL = 0.05  # a plot's axis spans this at least, in its unit: rounding is not to be seen
SNAPSHOTS = 9
SPACING = 1.15  # between two snapshots that would stand on each other, in widths of the mass
TRAVELS = 0.6  # a motion that covers this much of the strip is drawn where it happened
EVENLY = 0.3  # part of the snapshots' spacing that is even in time, not in what moves
STANDS = 0.02  # m: a foot that moves less stands still
SOLID = np.sqrt(5.0 / 3.0)  # semi-axis of the equimomental ellipsoid over r_k


def plot_pendulum(history: PendulumHistory, path: str | Path, title: str = "") -> None:
    """Draw a pendulum's motion into a file; see :func:`pendulum_figure`.

    Raises
    ------
    InvalidInputError
        A file type that cannot be drawn.
    """
    save(pendulum_figure(history, title), picture_file(path))


def pendulum_figure(history: PendulumHistory, title: str = "") -> Figure:
    """Return a figure of a pendulum's motion.

    Above, the masses' equimomental ellipsoid and the leg at even times, seen from the side on which
    most happens. Below, a phase portrait (leg's angle, or height where the foot moves or leaves the
    ground), CoM, CoP and CMP on the ground with the support polygons, and the angular momentum with
    the masses' distances.
    """
    strip = Figure().add_axes((0.0, 0.0, 1.0, 1.0))
    _strip(strip, history)
    (left, right), (low, high) = strip.get_xlim(), strip.get_ylim()
    tall = float(np.clip(STRIP_WIDTH * (high - low) / (right - left), *STRIP_HEIGHT))
    height = HEADING + tall + BETWEEN + PLOTS + BELOW
    figure = Figure(figsize=(WIDTH, height), dpi=style.DPI)

    def placed(x: float, y: float, wide: float, high: float) -> Axes:
        return figure.add_axes((x / WIDTH, y / height, wide / WIDTH, high / height))

    _strip(placed((WIDTH - STRIP_WIDTH) / 2, BELOW + PLOTS + BETWEEN, STRIP_WIDTH, tall), history)
    for k, draw in enumerate((_portrait, _ground, _momentum)):
        draw(placed(FIRST + k * (PLOT_WIDTH + GAP), BELOW, PLOT_WIDTH, PLOTS), history)
    if title:
        style.heading(figure, title, 1.0 - 0.12 / height)
    return figure


# ---------------------------------------------------------------------- the strip


def _strip(axes: Axes, history: PendulumHistory) -> None:
    """Draw snapshots side by side, or where they were if the pendulum travels."""
    chosen = _moments(history)
    side = _side(history)
    along = history.com @ side
    size = SOLID * float(history.radii[chosen].max())
    reach = max(2.0 * size, _sway(history, side))
    apart = SPACING * reach
    travels = float(np.ptp(along)) > TRAVELS * apart * (len(chosen) - 1)
    for place, k in enumerate(chosen.tolist()):
        shift = 0.0 if travels else place * apart - _origin(history, k) @ side
        _snapshot(axes, history, k, side, shift, faint=0.35 + 0.65 * place / (len(chosen) - 1))
    axes.axhline(0.0, color=style.GREY, linewidth=0.9, zorder=0)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_yticks([])
    if travels:
        axes.tick_params(labelsize=style.SMALL, colors=style.BLACK, width=0.6, length=3)
        axes.set_xlabel("along the ground [m]", fontsize=style.SMALL, color=style.BLACK)
    else:
        axes.set_xticks([place * apart for place in range(len(chosen))])
        axes.set_xticklabels(
            [f"{round(float(history.time[k]), 2):g} s" for k in chosen], fontsize=style.SMALL
        )
        axes.tick_params(length=0, colors=style.BLACK)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _moments(history: PendulumHistory) -> NDArray[np.intp]:
    """Return the places of the snapshots: spread over what happens more than over time."""
    turned = np.einsum("nji,njk->nik", history.axes[:-1], history.axes[1:])
    angle = np.arccos(np.clip((np.trace(turned, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0))
    slid = np.abs(np.diff(history.radii, axis=0)).sum(axis=1)
    moved = np.linalg.norm(np.diff(history.com, axis=0), axis=1) + slid
    way = np.cumsum(moved + history.radii[1:].max(axis=1) * angle)
    share = np.concatenate(((0.0,), way / max(float(way[-1]), 1e-12)))
    even = history.time / max(float(history.time[-1]), 1e-12)
    measure = EVENLY * even + (1.0 - EVENLY) * share
    wanted = np.linspace(measure[0], measure[-1], SNAPSHOTS)
    return np.unique(np.searchsorted(measure, wanted).clip(0, len(measure) - 1))


def _side(history: PendulumHistory) -> Array:
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


def _origin(history: PendulumHistory, k: int) -> Array:
    """Return what a snapshot is centred on: the foot, or the CoM in flight."""
    foot: Array = history.foot[k]
    return history.com[k] if np.isnan(foot).any() else foot


def _sway(history: PendulumHistory, side: Array) -> float:
    """Return how far the CoM gets from its foot, to both sides."""
    arms = (history.com - history.foot) @ side
    return 2.0 * float(np.nanmax(np.abs(arms), initial=0.0))


def _snapshot(
    axes: Axes, history: PendulumHistory, k: int, side: Array, shift: float, faint: float
) -> None:
    def seen(point: Array) -> tuple[float, float]:
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


def _wheel(
    axes: Axes, centre: tuple[float, float], r: float, dx: float, dz: float, faint: float
) -> None:
    """Draw the planar pendulum's wheel with its two masses."""
    axes.add_patch(
        Ellipse(centre, 2 * r, 2 * r, facecolor=style.TINT, alpha=0.25 * faint, edgecolor="none")
    )
    axes.add_patch(
        Ellipse(centre, 2 * r, 2 * r, fill=False, edgecolor=style.TINT, alpha=faint, linewidth=1.0)
    )
    x = (centre[0] - r * dx, centre[0] + r * dx)
    z = (centre[1] - r * dz, centre[1] + r * dz)
    axes.plot(x, z, color=style.VERMILION, linewidth=1.0, marker="o", markersize=4.0, alpha=faint)


def _shadow(
    axes: Axes, centre: tuple[float, float], shape: Array, view: Array, faint: float
) -> None:
    """Draw the outline of an ellipsoid with semi-axes ``shape`` as seen by ``view`` (2, 3)."""
    squares, directions = np.linalg.eigh((view * shape**2) @ view.T)
    a, b = np.sqrt(np.maximum(squares[::-1], 0.0)).tolist()
    angle = float(np.degrees(np.arctan2(directions[1, 1], directions[0, 1])))
    for fill, strength in ((True, 0.28 * faint), (False, faint)):
        axes.add_patch(
            Ellipse(
                centre, 2 * a, 2 * b, angle=angle, fill=fill, alpha=strength, linewidth=1.0,
                facecolor=style.TINT if fill else "none", edgecolor="none" if fill else style.TINT,
            )
        )  # fmt: skip


# ---------------------------------------------------------------------- the plots


def _portrait(axes: Axes, history: PendulumHistory) -> None:
    """Draw the leg's angle from the vertical, or the CoM's height, against its rate."""
    foot = history.foot
    stays = not np.isnan(foot).any() and float(np.ptp(foot, axis=0).max()) < STANDS
    x: Array
    y: Array
    if stays:
        leg = history.com - foot
        rate = history.com_velocity
        side = _side(history)
        across, up = leg @ side, leg[:, 2]
        angle = np.unwrap(np.arctan2(across, up))
        speed = ((rate @ side) * up - rate[:, 2] * across) / (across**2 + up**2)
        x, y = np.degrees(angle), speed
        style.plain(axes, "Phase portrait", "leg from the vertical [°]", "rate [rad/s]")
    else:
        # Where the CoM hardly rises, as in walking, its sway tells more than its height.
        sways = not history.flat and np.ptp(history.com[:, 1]) > np.ptp(history.com[:, 2])
        k, what = (1, "sideways, y") if sways else (2, "height")
        x, y = history.com[:, k], history.com_velocity[:, k]
        style.plain(axes, "Phase portrait", f"{what} of the CoM [m]", "rate [m/s]")
    names = list(dict.fromkeys(history.phase))
    for name, colour in zip(names, _colours(len(names)), strict=True):
        inside = np.array([phase == name for phase in history.phase])
        inside[1:] |= inside[:-1]  # no gaps between phases
        axes.plot(np.where(inside, x, np.nan), y, color=colour, linewidth=1.2, label=name)
    ends: dict[str, Any] = {"color": style.BLACK, "markersize": 4, "linestyle": "none"}
    axes.plot(x[0], y[0], marker="o", label="start", **ends)
    axes.plot(x[-1], y[-1], marker="s", label="end", **ends)
    axes.set_ylim(*_range(axes.get_ylim(), STILL / 2))
    _legend(axes)


def _colours(count: int) -> list[str]:
    return [style.SERIES[k % len(style.SERIES)] for k in range(count)]


def _ground(axes: Axes, history: PendulumHistory) -> None:
    """Draw CoM, CoP and CMP on the ground, or over time where they move on a line."""
    if history.flat:
        style.plain(axes, "On the ground", "time [s]", "x [m]")
        for support in history.supports:
            low, high = support.polygon[:, 0].min(), support.polygon[:, 0].max()
            span = (support.start, support.end)
            axes.fill_between(span, low, high, color=style.GREY, alpha=0.25, linewidth=0)
        for points, colour, name in _traces(history):
            axes.plot(history.time, points[:, 0], color=colour, linewidth=_WIDTHS[name], label=name)
        axes.set_ylim(*_shown(history, 0))
    else:
        style.plain(axes, "On the ground", "x [m]", "y [m]")
        for support in history.supports:
            axes.add_patch(
                Polygon(support.polygon, facecolor=style.GREY, alpha=0.22, edgecolor=style.GREY)
            )
        for points, colour, name in _traces(history):
            axes.plot(points[:, 0], points[:, 1], color=colour, linewidth=_WIDTHS[name], label=name)
        _square(axes, _shown(history, 0), _shown(history, 1))
    _legend(axes)


def _square(axes: Axes, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Show both ranges at the same scale."""
    scale = max((x[1] - x[0]) / PLOT_WIDTH, (y[1] - y[0]) / PLOTS)  # m per inch
    for (low, high), inches, limit in ((x, PLOT_WIDTH, axes.set_xlim), (y, PLOTS, axes.set_ylim)):
        middle, half = 0.5 * (low + high), 0.5 * scale * inches
        limit(middle - half, middle + half)


def _shown(history: PendulumHistory, k: int) -> tuple[float, float]:
    """Return the range of a coordinate: all of CoM, CoP and supports, not all of a far-off CMP."""
    inner = [history.com[:, k], history.cop[:, k]]
    inner += [support.polygon[:, k] for support in history.supports]
    low = min(float(np.nanmin(part, initial=np.inf)) for part in inner)
    high = max(float(np.nanmax(part, initial=-np.inf)) for part in inner)
    size = max(high - low, 0.05)
    far = history.cmp[:, k]
    low = max(min(low, float(np.nanmin(far, initial=low))), low - size)
    high = min(max(high, float(np.nanmax(far, initial=high))), high + size)
    return low - 0.06 * size, high + 0.06 * size


# The wider below, so that each is seen where they coincide.
_WIDTHS = {"CMP": 2.6, "CoM": 1.1, "CoP": 1.4}


def _traces(history: PendulumHistory) -> list[tuple[Array, str, str]]:
    return [
        (history.cmp, style.ORANGE, "CMP"),
        (history.com, style.BLACK, "CoM"),
        (history.cop, style.BLUE, "CoP"),
    ]


def _momentum(axes: Axes, history: PendulumHistory) -> None:
    """Draw the angular momentum about the CoM and, on a second axis, the masses' distances."""
    style.plain(axes, "Momentum and masses", "time [s]", "angular momentum [kg m²/s]")
    # A planar pendulum turns about -y.
    parts = {"about -y": -history.momentum[:, 1]}
    if not history.flat:
        parts = {f"about {name}": history.momentum[:, k] for k, name in enumerate("xyz")}
    for (name, values), colour in zip(parts.items(), style.SERIES, strict=False):
        axes.plot(history.time, values, color=colour, linewidth=1.2, label=name)
    # Constant to rounding: a line, not noise blown up to the size of the plot.
    largest = max(float(np.abs(values).max()) for values in parts.values())
    axes.set_ylim(*_range(axes.get_ylim(), 0.02 * max(largest, 1.0)))
    second: Any = axes.twinx()
    radii = {"r": history.radii[:, 0]} if history.flat else _named(history.radii)
    for (name, values), colour in zip(radii.items(), style.PRINCIPAL, strict=False):
        second.plot(
            history.time, values, color=colour, linewidth=1.0, linestyle=(0, (4, 2)), label=name
        )
    second.set_ylabel("distance of the masses [m]", fontsize=style.SMALL, color=style.BLACK)
    second.tick_params(labelsize=style.SMALL, colors=style.BLACK, width=0.6, length=3)
    second.set_ylim(0.0, 1.25 * max(float(history.radii.max()), 1e-3))
    for side in ("top", "left", "bottom"):
        second.spines[side].set_visible(False)
    second.spines["right"].set_color(style.GREY)
    lines = axes.get_lines() + second.get_lines()
    second.legend(lines, [line.get_label() for line in lines], **_LEGEND, ncols=2)


def _named(radii: Array) -> dict[str, Array]:
    return {f"r{style.INDEX[k]}": radii[:, k] for k in range(3)}


def _range(limits: tuple[float, float], least: float) -> tuple[float, float]:
    low, high = limits
    middle, half = 0.5 * (low + high), max(0.5 * (high - low), least)
    return middle - half, middle + half


_LEGEND: dict[str, Any] = {
    "fontsize": style.SMALL - 1.5,
    "frameon": True,
    "framealpha": 0.75,
    "edgecolor": "none",
    "handlelength": 1.2,
    "borderpad": 0.2,
    "labelspacing": 0.25,
}


def _legend(axes: Axes) -> None:
    axes.legend(**_LEGEND)
