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

WIDTH, HEIGHT, DPI = 6.0, 2.7, 130  # inches, pixels per inch


def report_plots(run: Run) -> list[dict[str, Any]]:
    """Return each plot as PNG in base64, and where the ends of its time axis are in it."""
    draws: list[Callable[[Axes], None]] = [
        lambda axes: plot_errors(axes, run.time, run.errors),
        lambda axes: plot_moments(axes, run.time, run.moments),
    ]
    if run.clearance:
        draws.append(lambda axes: plot_clearance(axes, run.time, run.clearance))
    if run.active:
        draws.append(lambda axes: plot_held_back(axes, run.time, run.active))
    return [_picture(draw) for draw in draws]


def _picture(draw: Callable[[Axes], None]) -> dict[str, Any]:
    figure = style.sheet(WIDTH, HEIGHT, None, HEIGHT)
    figure.set_dpi(DPI)
    axes = figure.subplots()
    draw(axes)
    FigureCanvasAgg(figure).draw()  # the layout is known only then
    place, (start, end) = axes.get_position(), axes.get_xlim()
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=DPI)
    return {
        "png": base64.b64encode(file.getvalue()).decode("ascii"),
        "times": [float(start), float(end)],
        "across": [float(place.x0), float(place.x1)],
        "title": axes.get_title(loc="left"),
    }
