"""How well a pendulum is balanced: pushes survived all around, and starts brought to rest."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.validate import Array, finite_array, finite_vector
from wbc.view import style

SIDE, HIGH = 3.4, 3.35  # inches


def pushes_figure(directions: ArrayLike, impulses: Mapping[str, ArrayLike]) -> Figure:
    """Return a polar plot of impulses by direction.

    Parameters
    ----------
    directions:
        (n, 2), of any length but zero, in order around.
    impulses:
        Sizes (n,) [N s] by what they are; the last is drawn with markers.

    Raises
    ------
    InvalidInputError
        Wrong sizes, not finite, a direction of no length, or nothing to draw.
    """
    across = finite_array("directions", directions, (len(np.atleast_2d(directions)), 2))
    if not np.any(across, axis=1).all():
        raise InvalidInputError("directions: each must have a length")
    if not impulses:
        raise InvalidInputError("impulses: needs at least one size for each direction")
    angle = np.arctan2(across[:, 1], across[:, 0])
    figure = style.sheet(1.25 * SIDE, 1.45 * SIDE)
    axes: Any = figure.add_axes((0.12, 0.23, 0.76, 0.64), projection="polar")
    closed = np.append(angle, angle[:1])
    names = list(impulses)
    for name, colour in zip(names, cycle(style.SERIES), strict=False):
        size = finite_vector(name, impulses[name], len(angle))
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


def regions_figure(
    x_leans: ArrayLike, y_leans: ArrayLike, settling: Mapping[str, ArrayLike]
) -> Figure:
    """Return maps of how long a law takes to bring a leaning pendulum to rest.

    Parameters
    ----------
    x_leans, y_leans:
        Starts' leans toward x (n,) and y (m,) [rad], growing in even steps.
    settling:
        Times [s] (n, m) by law; NaN where it fell.

    Raises
    ------
    InvalidInputError
        Wrong sizes, or no map.
    """
    if not settling:
        raise InvalidInputError("settling: needs at least one map")
    x, y = _even("x_leans", x_leans), _even("y_leans", y_leans)
    maps = {name: np.asarray(times, dtype=float) for name, times in settling.items()}
    for name, times in maps.items():
        if times.shape != (len(x), len(y)):
            raise InvalidInputError(f"settling of {name}: expected {(len(x), len(y))}")
        if np.isinf(times).any():
            raise InvalidInputError(f"settling of {name}: infinite; NaN says that it fell")
    longest = max((float(np.nanmax(m)) for m in maps.values() if np.isfinite(m).any()), default=1.0)
    count = len(maps)
    figure = style.sheet(1.2 + count * (SIDE - 0.4), HIGH, plots=HIGH)
    row = figure.subplots(1, count, squeeze=False)[0]
    half = [(axis[1] - axis[0]) / 2 if len(axis) > 1 else 0.5 for axis in (x, y)]
    extent = (x[0] - half[0], x[-1] + half[0], y[0] - half[1], y[-1] + half[1])
    drawn: Any = None
    for k, (axes, (name, times)) in enumerate(zip(row, maps.items(), strict=True)):
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


def _even(name: str, leans: ArrayLike) -> Array:
    """Return leans (n,) in degrees; a picture's cells are all of one size."""
    degrees = np.degrees(finite_vector(name, leans, np.size(leans)))
    steps = np.diff(degrees)
    if not len(degrees) or (steps <= 0.0).any() or not np.allclose(steps, steps[:1]):
        raise InvalidInputError(f"{name}: must grow in even steps, one value at least")
    return degrees
