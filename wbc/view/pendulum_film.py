"""A pendulum's motion as a film: seen from the side on which most happens."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wbc.problem.pendulum.result import PendulumHistory
from wbc.validate import Array
from wbc.view import style
from wbc.view.film import Progress, even_size, sheet, write_film
from wbc.view.pendulum import draw_snapshot
from wbc.view.pendulum_plots import SOLID, view_side

EDGE = 0.05  # of the picture, free on every side
HEAD = 0.12  # of its height, for the title


def film_pendulum(
    history: PendulumHistory,
    path: str | Path,
    *,
    title: str,
    fps: int = 20,
    speed: float = 1.0,
    size: tuple[int, int] = (480, 560),
    progress: Progress | None = None,
) -> Path:
    """Write a film of a pendulum's motion; the rest is as in :func:`wbc.view.film.film_run`."""
    return write_film(
        lambda: PendulumFilm(history, title, even_size(size)),
        history.time,
        path,
        fps,
        speed,
        progress,
    )


class PendulumFilm:
    """Draws a pendulum's rows one after the other, from where all of them are seen."""

    def __init__(self, history: PendulumHistory, title: str, size: tuple[int, int]) -> None:
        self._history, self._title, self._side = history, title, view_side(history)
        self.figure = sheet(size)
        self._axes = self.figure.add_axes((0.0, 0.0, 1.0, 1.0 - HEAD))
        self._head = self.figure.text(
            0.5, 1.0 - 0.3 * HEAD, "", ha="center", va="top", fontsize=8.0, color=style.BLACK
        )
        self._low, self._high = self._extent()

    def draw(self, row: int) -> None:
        """Draw a row, and the way of the CoM until then."""
        axes, history = self._axes, self._history
        axes.clear()
        axes.axis("off")
        axes.set_aspect("equal")
        axes.set_xlim(self._low[0], self._high[0])
        axes.set_ylim(self._low[1], self._high[1])
        axes.axhline(0.0, color=style.GREY, linewidth=0.9, zorder=0)
        way = history.com[: row + 1]
        axes.plot(way @ self._side, way[:, 2], color=style.GREY, linewidth=0.8, zorder=1)
        draw_snapshot(axes, history, row, self._side)
        phase = f", {history.phase[row]}" if history.phase[row] else ""
        self._head.set_text(f"{self._title}, t = {history.time[row]:.2f} s{phase}")

    def _extent(self) -> tuple[Array, Array]:
        """Return the corners (2,) of what is seen in the whole motion."""
        history = self._history
        reach = SOLID * history.radii.max()
        points = np.concatenate((history.com - reach, history.com + reach, history.foot))
        seen = np.column_stack((points @ self._side, points[:, 2]))
        com = history.com @ self._side  # minus and plus reach above are along x, y and z
        low = np.minimum(np.nanmin(seen, axis=0), (com.min() - reach, 0.0))
        high = np.maximum(np.nanmax(seen, axis=0), (com.max() + reach, 0.0))
        margin = EDGE * (high - low).max()
        return low - margin, high + margin
