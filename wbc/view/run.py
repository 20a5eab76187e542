"""A run of a controller in one figure: the robot, and the errors and inertias over time.

A run without phases shows the robot before and after, a run with phases at the end of each.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.spatial import vech
from wbc.validate import Array, finite_array
from wbc.view import style
from wbc.view.phased_run import PhasedRun, balance_of, phased_figure, phases_of
from wbc.view.portrait import draw_portraits, portraits_of, shape_of
from wbc.view.series import error_series, moment_series, plot_errors, plot_moments
from wbc.view.style import picture_file, save

WIDTH = 9.0  # inches
PANEL_SHAPE = (0.55, 0.95)  # height to width, at least and at most
HEADING, BETWEEN, PLOT = 0.65, 0.45, 2.9  # inches, from the top


class History(Protocol):
    """What a run leaves behind; more is drawn if there is more, see :func:`plot_run`."""

    @property
    def time(self) -> ArrayLike:
        """Times (n,) [s]."""

    @property
    def q(self) -> ArrayLike:
        """Configurations (n, nq)."""

    @property
    def errors(self) -> Mapping[str, ArrayLike]:
        """Error of each task, (n, k) or (n,)."""


def plot_run(robot: Robot, history: History, path: str | Path, *, title: str) -> Path:
    """Draw a run: the robot before and after, its tasks' errors and its principal moments.

    A run with phases is drawn at the end of each, with the phases marked in the plots and its
    balance in one more.

    Parameters
    ----------
    history:
        The run. Its ``inertia`` (n, 6), entries xx xy xz yy yz zz [kg m^2], is computed from ``q``
        if it has none. Errors may be NaN where a task was not active. It has phases if it has a
        ``phase`` (n,) that is not empty: the name of the phase at each time; it then may have a
        ``support`` (n,), what the robot stood on, and a ``balance`` (n,), the margin [m].
    path:
        The file: png, svg or pdf by its suffix.

    Returns
    -------
    The file.

    Raises
    ------
    InvalidInputError
        Another suffix, no such folder, an empty history or one whose arrays do not fit together.
    ModelError
        The robot's meshes cannot be read.
    """
    path = picture_file(path)
    save(run_figure(robot, history, title=title), path)
    return path


def run_figure(robot: Robot, history: History, *, title: str) -> Figure:
    """Return the figure that :func:`plot_run` writes."""
    time, q = _times_and_configurations(robot, history)
    errors = error_series(history.errors, len(time))
    moments = moment_series(_inertias(robot, history, q))
    phases = phases_of(history, time)
    if phases:
        balance = balance_of(history, len(time))
        return phased_figure(robot, PhasedRun(time, q, phases, balance, errors, moments), title)
    ends = {f"before, t = {time[0]:g} s": q[0], f"after, t = {time[-1]:g} s": q[-1]}
    portraits = portraits_of(robot, ends)
    high = 0.5 * WIDTH * float(np.clip(shape_of(portraits), *PANEL_SHAPE))
    below = BETWEEN + PLOT
    total = HEADING + high + below
    figure = style.sheet(WIDTH, total, title, PLOT)
    panels = [figure.add_axes((0.5 * k, below / total, 0.5, high / total)) for k in range(2)]
    draw_portraits(panels, portraits)
    left, right = figure.subplots(1, 2)
    plot_errors(left, time, errors)
    plot_moments(right, time, moments)
    return figure


# ---------------------------------------------------------------------- reading the history


def _times_and_configurations(robot: Robot, history: History) -> tuple[Array, Array]:
    count = np.size(history.time)
    if count == 0:
        raise InvalidInputError("history: it is empty; there is nothing to draw")
    time = finite_array("history: time", history.time, (count,))
    return time, finite_array("history: q", history.q, (count, robot.nq))


def _inertias(robot: Robot, history: History, q: Array) -> Array:
    given = getattr(history, "inertia", None)
    if given is None:
        return np.array([vech(robot.snapshot(one).inertia) for one in q])
    return finite_array("history: inertia", given, (len(q), 6))
