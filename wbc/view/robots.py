"""A figure of a robot in one or more configurations."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from wbc.robot import Robot
from wbc.view import portrait, style
from wbc.view.options import View

PANEL_WIDTH = 3.6  # inches, of a picture in a figure of robots
WIDEST = 3 * PANEL_WIDTH  # of the figure: in a wider one no text can be read on a page
PANEL_SHAPE = (0.8, 1.5)  # its height to width, at least and at most
ABOVE, BELOW = 0.3, 0.35  # inches of text above and below a picture


def robot_figure(
    robot: Robot,
    configurations: Mapping[str, ArrayLike | portrait.Pose],
    *,
    title: str | None = None,
    view: View = portrait.DEFAULT,
) -> Figure:
    """Return a figure of the robot in one or more configurations, side by side at one scale.

    Each shows the robot, its equimomental ellipsoid with the lengths of the semi-axes, the CoM, the
    six reaction masses M/6, the leg from the ground under the CoM, and the soles.

    Parameters
    ----------
    configurations:
        What to write above each picture, and its configuration q (nq,), or a
        :class:`~wbc.view.portrait.Pose`: one that floats, or with obstacles and targets.
    title:
        Written above all.
    view:
        What is drawn, and from where.

    Raises
    ------
    InvalidInputError
        No configuration, or an unusable one.
    ModelError
        The robot's meshes cannot be read.
    """
    portraits = portrait.portraits_of(robot, configurations, view)
    count, heading = len(portraits), 0.0 if title is None else ABOVE
    return portrait.sheet_with_portraits(
        portraits, min(PANEL_WIDTH, WIDEST / count), PANEL_SHAPE, columns=count, title=title,
        above=(heading, ABOVE), below=(BELOW, 0.0),
    )  # fmt: skip


def plot_robot(
    robot: Robot,
    configurations: Mapping[str, ArrayLike | portrait.Pose],
    path: str | Path,
    *,
    title: str | None = None,
    view: View = portrait.DEFAULT,
) -> Path:
    """Write :func:`robot_figure` to a file, png, svg or pdf by its suffix, and return its path.

    Raises
    ------
    InvalidInputError
        Also for another suffix, or a folder that does not exist.
    """
    path = style.picture_file(path)
    return style.save(robot_figure(robot, configurations, title=title, view=view), path)
