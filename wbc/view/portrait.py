"""A robot in one or more configurations: portraits with ellipsoid and pendulum, side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.rmp.ellipsoid import equimomental, reaction_mass_radii
from wbc.robot import Robot, Snapshot
from wbc.robot.geometry import Mesh, RobotMeshes
from wbc.validate import Array
from wbc.view import style
from wbc.view.camera import Camera, viewing_axes
from wbc.view.panel import Panel
from wbc.view.render import render
from wbc.view.scene import Scene, principal_sections, silhouette, sole_outline

AZIMUTH, ELEVATION = np.deg2rad(33.0), np.deg2rad(12.0)  # from the robot's front left
SUNK = 0.02  # m: a robot reaching lower than this below z = 0 is not meant to stand there
INCH = 72.0  # points
TEXT_WIDTH = 0.95  # inches, of a semi-axis as written below a picture
NARROW = 1.0 / 3.3  # distance between two of them where there is less room, part of the width
PANEL_WIDTH = 3.6  # inches, of a picture in a figure of robots
PANEL_SHAPE = (0.8, 1.5)  # its height to width, at least and at most
ABOVE, BELOW = 0.3, 0.35  # inches of text above and below a picture


@dataclass(frozen=True, eq=False)
class Portrait:
    """A robot in one configuration.

    Attributes
    ----------
    name:
        What is written above it.
    snapshot:
        The robot at that configuration.
    scene:
        Its meshes, ellipsoid, CoM and ground.
    outlines:
        Closed curves (k, 3) [m]: the soles, or the support polygon.
    foot:
        Lower end of the pendulum's leg (3,) [m]; None for no leg.
    radii:
        Distances (3,) [m] of the reaction masses from the CoM.
    """

    name: str
    snapshot: Snapshot
    scene: Scene
    outlines: Sequence[Array]
    foot: Array | None
    radii: Array


def portraits_of(robot: Robot, configurations: Mapping[str, ArrayLike]) -> list[Portrait]:
    """Return portraits by the names written above them; see :func:`wbc.view.robot_figure`."""
    if not configurations:
        raise InvalidInputError("configurations: there is none to draw; give at least one")
    meshes = RobotMeshes(robot)
    return [_portrait(robot.snapshot(q), meshes.at(q), name) for name, q in configurations.items()]


def _portrait(snapshot: Snapshot, meshes: Sequence[Mesh], name: str) -> Portrait:
    """Return the portrait of a robot at rest: the CoP is the CoM's projection."""
    robot = snapshot.robot
    lowest = min((float(mesh.vertices[:, 2].min()) for mesh in meshes), default=0.0)
    ground = lowest if lowest < -SUNK else 0.0
    ellipsoid = equimomental(snapshot.inertia, robot.mass)
    scene = Scene(meshes, ellipsoid, snapshot.com, style.TINT, ground)
    soles = [sole_outline(snapshot, foot) for foot in robot.feet.values()]
    radii = reaction_mass_radii(ellipsoid.inertia(), robot.mass)
    return Portrait(name, snapshot, scene, soles, scene.below_centre, radii)


def shape_of(portraits: Sequence[Portrait]) -> float:
    """Return the ratio of height to width of a picture that the portraits fill."""
    across, along, _ = np.ptp(_extent(portraits) @ viewing_axes(AZIMUTH, ELEVATION).T, axis=0)
    return float(along / across)


def panels_of(all_axes: Sequence[Axes], portraits: Sequence[Portrait]) -> list[Panel]:
    """Render each portrait on axes of its own, all equally large, from one side, at one scale."""
    width, height = _inches(all_axes[0])
    pixels = round(width * style.DPI), round(height * style.DPI)
    camera = Camera.framing(_extent(portraits), AZIMUTH, ELEVATION, *pixels)
    panels = []
    for axes, portrait in zip(all_axes, portraits, strict=True):
        here = camera.moved(portrait.scene.below_centre)
        panels.append(Panel(axes, here, render(portrait.scene, here), style.DPI / INCH))
        panels[-1].show()
    return panels


def draw_portraits(all_axes: Sequence[Axes], portraits: Sequence[Portrait]) -> None:
    """Draw each portrait with its ellipsoid's sections, and the semi-axes below it."""
    for panel, portrait in zip(panels_of(all_axes, portraits), portraits, strict=True):
        draw_pendulum(panel, portrait, sections=True)
        panel.axes.set_title(portrait.name, fontsize=style.NORMAL, color=style.BLACK)
        width = _inches(panel.axes)[0]
        narrow = width < 3.0 * TEXT_WIDTH
        unit = "" if narrow else " mm"  # where there is no room the figure says it once
        semi_axes = 1e3 * portrait.scene.ellipsoid.semi_axes
        texts = [f"a{style.INDEX[k]} {a:.0f}{unit}" for k, a in enumerate(semi_axes)]
        size = style.SMALL if narrow else style.NORMAL
        style.write_below(panel.axes, texts, NARROW if narrow else TEXT_WIDTH / width, size)


def draw_pendulum(
    panel: Panel,
    portrait: Portrait,
    size: float = 1.0,
    widths: tuple[float, float] = (1.2, 1.1),
    sections: bool = False,
) -> None:
    """Draw outlines, leg, ellipsoid with its axes, and the six masses on them (paper Fig. 5).

    Parameters
    ----------
    size:
        Of the pendulum's lines and marks.
    widths:
        Of the outlines on the ground and of the ellipsoid's [points].
    sections:
        True to draw the ellipsoid's principal sections.
    """
    centre, ellipsoid, foot = portrait.scene.centre, portrait.scene.ellipsoid, portrait.foot
    for outline in portrait.outlines:
        panel.curve(outline, style.ORANGE, widths[0], hidden=0.6)
    edge = silhouette(ellipsoid, centre, panel.camera.eye)
    panel.curve(edge, style.BLUE, widths[1], hidden=0.35)
    for section in principal_sections(ellipsoid, centre) if sections else ():
        panel.curve(section, style.BLUE, 0.5, hidden=0.2)
    if foot is not None:
        panel.line(foot, centre, style.BLACK, 2.2 * size)
    for k, colour in enumerate(style.PRINCIPAL):
        axis, reach = ellipsoid.axes[:, k], ellipsoid.semi_axes[k]
        panel.line(centre - reach * axis, centre + reach * axis, colour, 0.9 * size)
        for distance in (-portrait.radii[k], portrait.radii[k]):
            panel.ball(centre + distance * axis, colour, 3.2 * size)
    if foot is not None:
        panel.ball(foot, style.BLACK, 2.6 * size)
    panel.centre_of_mass(centre, 5.5 * size)


def _extent(portraits: Sequence[Portrait]) -> Array:
    return np.concatenate([portrait.scene.extent for portrait in portraits])


def _inches(axes: Axes) -> tuple[float, float]:
    dpi = axes.figure.dpi
    return float(axes.bbox.width / dpi), float(axes.bbox.height / dpi)


# ---------------------------------------------------------------------- figures


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
    figure = style.sheet(width * count, total, title)
    panels = [style.place(figure, width * k, BELOW, width, height) for k in range(count)]
    draw_portraits(panels, portraits)
    return figure


def plot_robot(
    robot: Robot,
    configurations: Mapping[str, ArrayLike],
    path: str | Path,
    *,
    title: str | None = None,
) -> Path:
    """Write :func:`robot_figure` to a file, png, svg or pdf by its suffix, and return its path.

    Raises
    ------
    InvalidInputError
        Also for another suffix, or a folder that does not exist.
    """
    path = style.picture_file(path)
    style.save(robot_figure(robot, configurations, title=title), path)
    return path
