"""A pendulum's motion in one figure: a strip of ellipsoids on their legs, and plots below."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wbc.problem.pendulum.result import PendulumHistory
from wbc.view import style
from wbc.view.files import picture_file, save
from wbc.view.pendulum_plots import HEIGHT, draw_ground, draw_momentum, draw_portrait
from wbc.view.pendulum_plots import WIDTH as PLOT_WIDTH
from wbc.view.pendulum_strip import draw_strip

WIDTH = 9.2  # inches
BETWEEN, HEADING, BELOW = 0.85, 0.45, 0.5  # inches
STRIP_WIDTH = 8.2  # inches
STRIP_HEIGHT = (0.9, 3.4)  # inches, at least and at most
FIRST, GAP = 0.78, 0.76  # inches, along the row of plots


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
    draw_strip(strip, history)
    (left, right), (low, high) = strip.get_xlim(), strip.get_ylim()
    tall = float(np.clip(STRIP_WIDTH * (high - low) / (right - left), *STRIP_HEIGHT))
    height = HEADING + tall + BETWEEN + HEIGHT + BELOW
    figure = Figure(figsize=(WIDTH, height), dpi=style.DPI)

    def placed(x: float, y: float, wide: float, high: float) -> Axes:
        return figure.add_axes((x / WIDTH, y / height, wide / WIDTH, high / height))

    draw_strip(
        placed((WIDTH - STRIP_WIDTH) / 2, BELOW + HEIGHT + BETWEEN, STRIP_WIDTH, tall), history
    )
    for k, draw in enumerate((draw_portrait, draw_ground, draw_momentum)):
        draw(placed(FIRST + k * (PLOT_WIDTH + GAP), BELOW, PLOT_WIDTH, HEIGHT), history)
    if title:
        style.heading(figure, title, 1.0 - 0.12 / height)
    return figure
