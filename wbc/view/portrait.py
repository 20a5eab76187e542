"""A robot in one configuration, and what is drawn about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.rmp import equimomental, reaction_mass_radii
from wbc.robot import Robot, Snapshot
from wbc.robot.geometry import Mesh, RobotMeshes
from wbc.validate import Array
from wbc.view import shapes, style
from wbc.view.camera import Camera, viewing_axes
from wbc.view.panel import Panel
from wbc.view.render import render
from wbc.view.scene import Scene

AZIMUTH, ELEVATION = np.deg2rad(33.0), np.deg2rad(12.0)  # from the robot's front left
SUNK = 0.02  # m: a robot reaching lower than this below z = 0 is not meant to stand there
INCH = 72.0  # points
TEXT_WIDTH = 0.95  # inches, of a semi-axis as written below a picture


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
    """

    name: str
    snapshot: Snapshot
    scene: Scene

    @property
    def below_com(self) -> Array:
        """The point of the ground under the CoM (3,): the CoP of a robot at rest."""
        x, y, _ = self.scene.centre
        return np.array([x, y, self.scene.ground])

    @property
    def extent(self) -> Array:
        """Points (k, 3) that a picture must contain, relative to :attr:`below_com`."""
        sections = shapes.principal_sections(self.scene.ellipsoid, self.scene.centre)
        vertices = [mesh.vertices for mesh in self.scene.meshes]
        return np.concatenate([*vertices, *sections, self.below_com[None]]) - self.below_com


def portraits_of(robot: Robot, configurations: Mapping[str, ArrayLike]) -> list[Portrait]:
    """Return portraits by the names written above them; see :func:`wbc.view.robot_figure`."""
    if not configurations:
        raise InvalidInputError("configurations: there is none to draw; give at least one")
    meshes = RobotMeshes(robot)
    return [_portrait(robot, meshes, name, q) for name, q in configurations.items()]


def _portrait(robot: Robot, meshes: RobotMeshes, name: str, q: ArrayLike) -> Portrait:
    snapshot, placed = robot.snapshot(q), meshes.at(q)
    ellipsoid = equimomental(snapshot.inertia, robot.mass)
    scene = Scene(placed, ellipsoid, snapshot.com, style.TINT, _ground(placed))
    return Portrait(name, snapshot, scene)


def _ground(meshes: Sequence[Mesh]) -> float:
    lowest = min((float(mesh.vertices[:, 2].min()) for mesh in meshes), default=0.0)
    return lowest if lowest < -SUNK else 0.0


def shape_of(portraits: Sequence[Portrait]) -> float:
    """Return the ratio of height to width of a picture that the portraits fill."""
    across, along, _ = np.ptp(_extent(portraits) @ viewing_axes(AZIMUTH, ELEVATION).T, axis=0)
    return float(along / across)


def draw_portraits(panels: Sequence[Axes], portraits: Sequence[Portrait]) -> None:
    """Draw each portrait on axes of its own, all equally large, from one side and at one scale."""
    width, height = _inches(panels[0])
    pixels = round(width * style.DPI), round(height * style.DPI)
    camera = Camera.framing(_extent(portraits), AZIMUTH, ELEVATION, *pixels)
    for axes, portrait in zip(panels, portraits, strict=True):
        _draw(axes, portrait, camera.moved(portrait.below_com))


def _extent(portraits: Sequence[Portrait]) -> Array:
    return np.concatenate([portrait.extent for portrait in portraits])


def _inches(axes: Axes) -> tuple[float, float]:
    box, figure = axes.get_position(), axes.get_figure()
    width, height = figure.get_size_inches() if isinstance(figure, Figure) else (0.0, 0.0)
    return float(box.width * width), float(box.height * height)


def _draw(axes: Axes, portrait: Portrait, camera: Camera) -> None:
    scene = portrait.scene
    panel = Panel(axes, camera, render(scene, camera), style.DPI / INCH)
    panel.show()
    _draw_soles(panel, portrait.snapshot)
    _draw_ellipsoid(panel, scene)
    _draw_pendulum(panel, portrait)
    axes.set_xlim(0.0, camera.width)
    axes.set_ylim(camera.height, 0.0)
    axes.set_title(portrait.name, fontsize=style.NORMAL, color=style.BLACK)
    _write_semi_axes(axes, scene.ellipsoid.semi_axes)


def _draw_soles(panel: Panel, snapshot: Snapshot) -> None:
    for foot in snapshot.robot.feet.values():
        panel.curve(shapes.sole_outline(snapshot, foot), style.ORANGE, 1.2, hidden=0.6)


def _draw_ellipsoid(panel: Panel, scene: Scene) -> None:
    outline = shapes.silhouette(scene.ellipsoid, scene.centre, panel.camera.eye)
    panel.curve(outline, style.BLUE, 1.1, hidden=0.35)
    for section in shapes.principal_sections(scene.ellipsoid, scene.centre):
        panel.curve(section, style.BLUE, 0.5, hidden=0.2)


def _draw_pendulum(panel: Panel, portrait: Portrait) -> None:
    """Draw the leg, the tracks along the ellipsoid's axes and the six masses (paper Fig. 5)."""
    centre, ellipsoid = portrait.scene.centre, portrait.scene.ellipsoid
    radii = reaction_mass_radii(ellipsoid.inertia(), ellipsoid.mass)
    panel.line(portrait.below_com, centre, style.BLACK, 2.2)
    for k, colour in enumerate(style.PRINCIPAL):
        axis, reach = ellipsoid.axes[:, k], ellipsoid.semi_axes[k]
        panel.line(centre - reach * axis, centre + reach * axis, colour, 0.9)
        for distance in (-radii[k], radii[k]):
            panel.ball(centre + distance * axis, colour, 3.2)
    panel.ball(portrait.below_com, style.BLACK, 2.6)
    panel.centre_of_mass(centre, 5.5)


def _write_semi_axes(axes: Axes, semi_axes: Array) -> None:
    width = _inches(axes)[0]
    narrow = width < 3.0 * TEXT_WIDTH
    apart = (1.0 / 3.3) if narrow else TEXT_WIDTH / width
    unit = "" if narrow else " mm"  # where there is no room the figure says it once
    for k, colour in enumerate(style.PRINCIPAL):
        axes.text(
            0.5 + apart * (k - 1),
            -0.015,
            f"a{style.INDEX[k]} {1e3 * semi_axes[k]:.0f}{unit}",
            color=colour,
            fontsize=style.SMALL if narrow else style.NORMAL,
            fontweight="bold",
            ha="center",
            va="top",
            transform=axes.transAxes,
        )
