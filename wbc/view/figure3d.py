"""A figure of a robot in one or more configurations."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from wbc.robot import Robot
from wbc.view import style
from wbc.view.files import picture_file, save
from wbc.view.portrait import draw_portraits, portraits_of, shape_of

PANEL_WIDTH = 3.6  # inches
PANEL_SHAPE = (0.8, 1.5)  # height to width, at least and at most
ABOVE, BELOW = 0.3, 0.35  # inches of text above and below a picture


def robot_figure(
    robot: Robot, configurations: Mapping[str, ArrayLike], *, title: str | None = None
) -> Figure:
    """Return a figure of the robot in one or more configurations, side by side at one scale.

    Each shows the robot, its equimomental ellipsoid with the lengths of the semi-axes, the CoM, the
    six reaction masses M/6, the leg from the ground under the CoM, and the soles.

    Parameters
    ----------
    configurations:
        What to write above each picture, and its configuration q (nq,).
    title:
        Written above all.

    Raises
    ------
    InvalidInputError
        No configuration, or an unusable one.
    ModelError
        The robot's meshes cannot be read.
    """
    portraits = portraits_of(robot, configurations)
    count, heading = len(portraits), 0.0 if title is None else ABOVE
    width, height = PANEL_WIDTH, PANEL_WIDTH * float(np.clip(shape_of(portraits), *PANEL_SHAPE))
    total = BELOW + height + ABOVE + heading
    figure = Figure(figsize=(width * count, total), dpi=style.DPI, facecolor="white")
    bottom, share = BELOW / total, height / total
    panels = [figure.add_axes((k / count, bottom, 1.0 / count, share)) for k in range(count)]
    draw_portraits(panels, portraits)
    if title is not None:
        style.heading(figure, title, 1.0 - 0.4 * heading / total)
    return figure


def plot_robot(
    robot: Robot,
    configurations: Mapping[str, ArrayLike],
    path: str | Path,
    *,
    title: str | None = None,
) -> Path:
    """Write :func:`robot_figure` to a file: png, svg or pdf by its suffix.

    Returns
    -------
    The file.

    Raises
    ------
    InvalidInputError
        Also for another suffix, or a folder that does not exist.
    """
    path = picture_file(path)
    save(robot_figure(robot, configurations, title=title), path)
    return path
