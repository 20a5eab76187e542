"""A robot at several moments in one picture, each in its place: a walk, and the ground below it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.simulation.terrain import LEVEL, Terrain
from wbc.validate import Array, finite_array, real_array
from wbc.view import style
from wbc.view.camera import Camera, viewing_axes
from wbc.view.options import View
from wbc.view.panel import Panel
from wbc.view.portrait import (
    INCH,
    LINE,
    Portrait,
    Pose,
    captions,
    draw_pendulum,
    extent_of,
    portraits_of,
    write_caption,
)
from wbc.view.render import render
from wbc.view.scene import Scene

WIDTH, ABOVE = 12.0, 0.22  # inches, of the picture and of the names above the robots
SHAPE = (0.2, 0.8)  # its height to width, at least and at most
NOWHERE: Array = np.empty((0, 3))
PATH = "black: path of the CoM on the ground"
SHOWN = View.of(show="robot,ground,soles,com")


def exposures_figure(
    robot: Robot,
    configurations: Mapping[str, ArrayLike],
    *,
    path_of_com: ArrayLike = NOWHERE,
    terrain: Terrain = LEVEL,
    view: View = SHOWN,
) -> Figure:
    """Return a figure of a robot at several moments in one picture.

    Parameters
    ----------
    configurations:
        What is written above each robot, and its configuration q (nq,).
    path_of_com:
        Where the CoM went (n, 3) [m]; drawn on the ground below.
    terrain:
        What the robot stands on.
    view:
        What is drawn of each robot, and from where.

    Raises
    ------
    InvalidInputError
        No configuration, or an unusable one.
    ModelError
        The robot's meshes cannot be read.
    """
    way = real_array("exposures, path_of_com", path_of_com)
    if way.ndim != 2 or way.shape[1] != 3:
        raise InvalidInputError(
            f"exposures, path_of_com: expected points (n, 3), got shape {way.shape}"
        )
    way = finite_array("exposures, path_of_com", way, way.shape)
    poses = {name: Pose(q, terrain=terrain) for name, q in configurations.items()}
    portraits = portraits_of(robot, poses, view)
    points = np.concatenate([extent_of(one) + one.scene.below_centre for one in portraits])
    across, along, _ = np.ptp(points @ viewing_axes(view.azimuth, view.elevation).T, axis=0)
    high = WIDTH * float(np.clip(along / across, *SHAPE))
    caption = captions(portraits, WIDTH)
    if len(way):
        caption[-1:] = [*(f"{told}; {PATH}" for told in caption[-1:])]
    below = LINE * len(caption)
    figure = style.sheet(WIDTH, high + ABOVE + below)
    axes = style.place(figure, 0.0, below, WIDTH, high)
    pixels = round(WIDTH * style.DPI), round(high * style.DPI)
    camera = Camera.framing(points, view.azimuth, view.elevation, *pixels)
    panel = Panel(axes, camera, render(together(portraits), camera), style.DPI / INCH)
    panel.show()
    if len(way):
        panel.curve(terrain.surface(way), style.BLACK, 0.8, hidden=0.2)
    for portrait in portraits:
        draw_pendulum(panel, portrait)
        _write_name(panel, portrait)
    write_caption(figure, caption, below)
    return figure


def together(portraits: Sequence[Portrait]) -> Scene:
    """Return one scene with the robots of all portraits; their ellipsoids are not in it."""
    scenes = [portrait.scene for portrait in portraits]
    first, centres = scenes[0], np.array([scene.centre for scene in scenes])
    return replace(
        first,
        meshes=[mesh for scene in scenes for mesh in scene.meshes],
        centre=0.5 * (centres.min(axis=0) + centres.max(axis=0)),
        ground=min(scene.ground for scene in scenes),
        glass=False,
        scale=first.size,
    )


def _write_name(panel: Panel, portrait: Portrait) -> None:
    """Write a portrait's name above its robot."""
    pixels, _ = panel.camera.project(extent_of(portrait) + portrait.scene.below_centre)
    x = float(panel.camera.project(portrait.scene.centre[None])[0][0, 0])
    panel.axes.text(
        x, pixels[:, 1].min(), portrait.name, ha="center", va="bottom", fontsize=style.NORMAL,
        color=style.BLACK,
    )  # fmt: skip
