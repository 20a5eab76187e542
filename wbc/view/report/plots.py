"""The plots of a report as pictures, and where time runs in each."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg

from wbc.view import style
from wbc.view.history import Run
from wbc.view.reasons import plot_clearance, plot_held_back
from wbc.view.series import plot_errors, plot_moments

Draw = Callable[[Axes], None]
WIDTH, HEIGHT, DPI = 6.0, 2.7, 130  # inches, pixels per inch


def report_plots(run: Run) -> list[Draw]:
    """Return what draws the plots of a run."""
    draws: list[Draw] = [
        lambda axes: plot_errors(axes, run.time, run.errors),
        lambda axes: plot_moments(axes, run.time, run.moments),
    ]
    if run.clearance:
        draws.append(lambda axes: plot_clearance(axes, run.time, run.clearance))
    if run.active:
        draws.append(lambda axes: plot_held_back(axes, run.time, run.active))
    return draws


def plot_picture(draw: Draw) -> dict[str, Any]:
    """Return a plot as PNG in base64, and where the ends of its time axis are, if it has one."""
    figure = style.sheet(WIDTH, HEIGHT, None, HEIGHT)
    figure.set_dpi(DPI)
    axes = figure.subplots()
    draw(axes)
    FigureCanvasAgg(figure).draw()  # the layout is known only then
    place, over_time = axes.get_position(), axes.get_xlabel().startswith("time")
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=DPI)
    return {
        "png": base64.b64encode(file.getvalue()).decode("ascii"),
        "times": list(map(float, axes.get_xlim())) if over_time else None,
        "across": [float(place.x0), float(place.x1)],
        "title": axes.get_title(loc="left"),
    }
