"""A robot in one or more configurations: portraits with ellipsoid and pendulum, side by side."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, shown
from wbc.kinds import check_kind
from wbc.rmp.ellipsoid import equimomental, reaction_mass_radii
from wbc.robot import Robot, Snapshot
from wbc.robot.collision import Shape
from wbc.robot.geometry import Mesh, RobotMeshes
from wbc.simulation.terrain import LEVEL, Terrain
from wbc.validate import Array
from wbc.view import style
from wbc.view.camera import Camera, viewing_axes
from wbc.view.options import LAYERS, View
from wbc.view.panel import Panel
from wbc.view.render import render
from wbc.view.scene import Scene, principal_sections, silhouette, sole_outline
from wbc.view.solids import solid_surface

DEFAULT = View()
REACH = 1.5  # sizes of the robot: the arrow of a force as large as its weight
WALL = 0.5  # half the side of a wall as drawn, in sizes of the robot
MOST_DISTANCE = 0.8  # sizes of the robot: what is farther from its CoM need not be in the picture
TARGET_REACHED = 5e-3  # m: a target no farther than this from its point is not marked
BELOW_GROUND = 0.02  # m: a robot that reaches lower below the ground does not stand there
INCH = 72.0  # points
TEXT_WIDTH = 0.95  # inches, of a semi-axis as written below a picture
LINE, CHARACTERS = 0.14, 18.0  # inches of a line of a caption, its characters per inch
NARROWEST = 5.2  # points of text per inch of a picture's width where three texts just fit
NARROW = 1.0 / 3.3  # distance between two of them where there is less room, part of the width


class TargetMark(NamedTuple):
    """A task's name, the point of the robot that it moves, and where to: (3,) each [m]."""

    name: str
    point: Array
    wanted: Array

    @property
    def distant(self) -> bool:
        """Whether the point is not there yet: only then the target is marked."""
        return float(np.linalg.norm(self.wanted - self.point)) > TARGET_REACHED


@dataclass(frozen=True, eq=False)
class Pose:
    """What is to be drawn of a robot."""

    q: ArrayLike  # (nq,)
    # Whether it stands on feet: then it has a leg, from the ground under the CoM.
    stands: bool = True
    grounded: bool = True  # whether there is a ground; a floating robot has none
    obstacles: Sequence[tuple[Shape, Array]] = ()  # shapes, and rotation and origin (3, 4) of each
    aims: Sequence[TargetMark] = ()  # where tasks want points of the robot
    terrain: Terrain = LEVEL  # the ground, if there is one
    # Wrenches (6,) from outside by frame, world axes [N, N m].
    wrenches: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Portrait:
    """A robot in one configuration."""

    name: str  # what is written above it
    snapshot: Snapshot  # the robot at that configuration
    scene: Scene  # its meshes, ellipsoid, CoM and ground
    outlines: Sequence[Array]  # closed curves (k, 3) [m]: the soles, or the support polygon
    foot: Array | None  # lower end of the pendulum's leg (3,) [m]; None for no leg
    radii: Array  # distances (3,) [m] of the reaction masses from the CoM
    aims: Sequence[TargetMark] = ()  # where tasks want points of the robot
    view: View = DEFAULT  # what is drawn, and from where
    arrows: Sequence[tuple[Array, Array]] = ()  # forces: points (3,) where they begin and end


def portraits_of(
    robot: Robot, configurations: Mapping[str, ArrayLike | Pose], view: View = DEFAULT
) -> list[Portrait]:
    """Return portraits by the names written above them; see :func:`wbc.view.robot_figure`."""
    if not isinstance(configurations, Mapping):
        got = shown(configurations)
        raise InvalidInputError(f'configurations: expected names, as in {{"start": q}}, got {got}')
    if not configurations:
        raise InvalidInputError("configurations: there is none to draw; give at least one")
    meshes = RobotMeshes(robot)
    poses = {
        name: one if isinstance(one, Pose) else Pose(one) for name, one in configurations.items()
    }
    return [
        portrait_of(robot.snapshot(pose.q), meshes.at(pose.q), pose, name, view)
        for name, pose in poses.items()
    ]


def portrait_of(
    snapshot: Snapshot, meshes: Sequence[Mesh], pose: Pose, name: str, view: View
) -> Portrait:
    """Return the portrait of a robot at rest: the CoP is the CoM's projection."""
    check_kind("view", view, View, 'View.of("front-left")')
    robot = snapshot.robot
    above = (mesh.vertices @ pose.terrain.upright for mesh in meshes)
    lowest = min((float(heights.min()) for heights in above), default=0.0)
    ground = lowest if lowest < -BELOW_GROUND or not pose.grounded else 0.0
    ellipsoid = equimomental(snapshot.inertia, robot.mass)
    scene = Scene(
        meshes if view.shows("robot") else (),
        ellipsoid,
        snapshot.com,
        style.TINT,
        ground,
        grounded=pose.grounded and view.shows("ground"),
        glass=view.shows("ellipsoid"),
        terrain=pose.terrain,
    )
    if view.shows("obstacles"):
        solids = [_solid(scene, shape, place) for shape, place in pose.obstacles]
        scene = replace(scene, solids=solids)
    outlines = [sole_outline(snapshot, foot) for foot in robot.feet.values()]
    radii = reaction_mass_radii(ellipsoid.inertia(), robot.mass)
    leg = scene.stood_on if pose.stands and robot.feet else None
    soles = outlines if pose.grounded else []
    longest = REACH * scene.size / robot.weight
    arrows = [
        (place, place + longest * wrench[:3])
        for place, wrench in ((snapshot.position(k), w) for k, w in pose.wrenches.items())
        if np.any(wrench[:3])
    ]
    return Portrait(name, snapshot, scene, soles, leg, radii, pose.aims, view, arrows)


def _solid(scene: Scene, shape: Shape, place: Array) -> Mesh:
    """Return an obstacle where it is; of a wall, what is near the robot."""
    R, origin = place[:, :3], place[:, 3]
    centre = (scene.centre - origin) @ R
    ground = float(scene.below_centre[2] - origin[2])  # of an upright wall; others do not turn
    surface = solid_surface(shape, centre, WALL * scene.size, ground)
    return Mesh("", surface.vertices @ R.T + origin, surface.faces, style.OBSTACLE)


def shape_of(portraits: Sequence[Portrait]) -> float:
    """Return the ratio of height to width of a picture that the portraits fill."""
    view = portraits[0].view
    axes = viewing_axes(view.azimuth, view.elevation)
    across, along, _ = np.ptp(_extent(portraits) @ axes.T, axis=0)
    return float(along / across)


def panels_of(all_axes: Sequence[Axes], portraits: Sequence[Portrait]) -> list[Panel]:
    """Render each portrait on axes of its own, all equally large, from one side, at one scale."""
    width, height = _inches(all_axes[0])
    pixels = round(width * style.DPI), round(height * style.DPI)
    view = portraits[0].view
    camera = Camera.framing(_extent(portraits), view.azimuth, view.elevation, *pixels)
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
        if not portrait.view.shows("ellipsoid"):
            continue
        width = _inches(panel.axes)[0]
        narrow = width < 3.0 * TEXT_WIDTH
        unit = "" if narrow else " mm"  # where there is no room the figure says it once
        semi_axes = 1e3 * portrait.scene.ellipsoid.semi_axes
        texts = [f"a{style.INDEX[k]} {a:.0f}{unit}" for k, a in enumerate(semi_axes)]
        size = min(style.SMALL, NARROWEST * width) if narrow else style.NORMAL
        style.write_below(panel.axes, texts, NARROW if narrow else TEXT_WIDTH / width, size)


def sheet_with_portraits(
    portraits: Sequence[Portrait],
    panel_width: float,
    shape: tuple[float, float],
    *,
    columns: int,
    above: tuple[float, float],
    below: tuple[float, float],
    title: str | None = None,
    width: float | None = None,
    plots: float = 0.0,
) -> Figure:
    """Return a figure with portraits in rows, what their marks are, and room for plots [inches].

    ``shape`` is a portrait's height to its width, at least and at most. There is room ``above`` all
    and each row, and ``below`` each row and the caption.
    """
    width = panel_width * columns if width is None else width
    high = panel_width * float(np.clip(shape_of(portraits), *shape))
    caption = captions(portraits, width)
    told, pitch = LINE * len(caption) + below[1], above[1] + high + below[0]
    total = above[0] + math.ceil(len(portraits) / columns) * pitch + told + plots
    figure = style.sheet(width, total, title, plots)
    left, top = 0.5 * (width - columns * panel_width), total - above[0] + below[0]
    places = [
        (left + k % columns * panel_width, top - (k // columns + 1) * pitch)
        for k in range(len(portraits))
    ]
    draw_portraits([style.place(figure, *at, panel_width, high) for at in places], portraits)
    write_caption(figure, caption, plots + told)
    return figure


def draw_pendulum(
    panel: Panel,
    portrait: Portrait,
    size: float = 1.0,
    widths: tuple[float, float] = (1.2, 1.1),
    sections: bool = False,
) -> None:
    """Draw outlines, leg, ellipsoid with its axes, and the six masses on them (paper Fig. 5).

    ``size``: of the pendulum's lines and marks.
    ``widths``: of the outlines on the ground and of the ellipsoid's [points].
    ``sections``: True to draw the ellipsoid's principal sections.
    """
    centre, ellipsoid, foot = portrait.scene.centre, portrait.scene.ellipsoid, portrait.foot
    shows = portrait.view.shows
    for outline in portrait.outlines if shows("soles") else ():
        panel.curve(outline, style.ORANGE, widths[0], hidden=0.6)
    if shows("ellipsoid"):
        edge = silhouette(ellipsoid, centre, panel.camera.eye)
        panel.curve(edge, style.BLUE, widths[1], hidden=0.35)
        for section in principal_sections(ellipsoid, centre) if sections else ():
            panel.curve(section, style.BLUE, 0.5, hidden=0.2)
    if foot is not None and shows("leg"):
        panel.line(foot, centre, style.BLACK, 2.2 * size)
    for k, colour in enumerate(style.PRINCIPAL):
        axis, reach = ellipsoid.axes[:, k], ellipsoid.semi_axes[k]
        if shows("ellipsoid") or shows("masses"):
            panel.line(centre - reach * axis, centre + reach * axis, colour, 0.9 * size)
        for distance in (-portrait.radii[k], portrait.radii[k]) if shows("masses") else ():
            panel.ball(centre + distance * axis, colour, 3.2 * size)
    if foot is not None and shows("leg"):
        panel.ball(foot, style.BLACK, 2.6 * size)
    if shows("com"):
        panel.centre_of_mass(centre, 5.5 * size)
    for aim in portrait.aims if shows("targets") else ():
        if aim.distant:
            panel.target(aim.point, aim.wanted, style.YELLOW, 4.0 * size)
    for start, end in portrait.arrows if shows("wrenches") else ():
        panel.arrow(start, end, style.VERMILION, 1.8 * size)


def captions(portraits: Sequence[Portrait], width: float) -> list[str]:
    """Return in lines what the marks in the pictures are, for a figure so wide [inches]."""
    there = {
        "leg": any(one.foot is not None for one in portraits),
        "soles": any(one.outlines for one in portraits),
        "obstacles": any(one.scene.solids for one in portraits),
        "targets": any(aim.distant for one in portraits for aim in one.aims),
        "wrenches": any(one.arrows for one in portraits),
    }
    view = portraits[0].view
    told = [
        text for name, text in LAYERS.items() if text and view.shows(name) and there.get(name, True)
    ]
    text, most = "; ".join(told), round(CHARACTERS * width)
    count = len(textwrap.wrap(text, most))
    while most > 1 and len(textwrap.wrap(text, most - 1)) == count:  # lines of about one length
        most -= 1
    return textwrap.wrap(text, most)


def write_caption(figure: Figure, lines: Sequence[str], top: float) -> None:
    """Write lines at a height above a figure's lower edge [inches]."""
    total = figure.get_size_inches()[1]
    figure.text(
        0.5, top / total, "\n".join(lines), ha="center", va="top", fontsize=7.0,
        color=style.GREY, linespacing=1.25,
    )  # fmt: skip


def _extent(portraits: Sequence[Portrait]) -> Array:
    """Return the points (k, 3) that each picture must contain, relative to the ground's point."""
    return np.concatenate([extent_of(portrait) for portrait in portraits])


def extent_of(portrait: Portrait) -> Array:
    """Return the points (k, 3) that a picture must contain, relative to ``scene.below_centre``."""
    scene = portrait.scene
    around = [mesh.vertices for mesh in scene.solids]
    around += [end[None] for _, end in portrait.arrows if portrait.view.shows("wrenches")]
    around += [aim.wanted[None] for aim in portrait.aims if portrait.view.shows("targets")]
    near = [
        p[np.linalg.norm(p - scene.centre, axis=1) < MOST_DISTANCE * scene.size] for p in around
    ]
    return np.concatenate([scene.extent, *(p - scene.below_centre for p in near)])


def _inches(axes: Axes) -> tuple[float, float]:
    dpi = axes.figure.dpi
    return float(axes.bbox.width / dpi), float(axes.bbox.height / dpi)
