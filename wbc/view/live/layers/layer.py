"""The base class of the scene's layers, and shapes that they share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np
from viser import SceneApi

from wbc.rmp.ellipsoid import Ellipsoid
from wbc.robot import Robot
from wbc.robot.collision import Capsule, Shape
from wbc.robot.formats.triangles import Triangles
from wbc.robot.geometry import Mesh, rounded_cylinder
from wbc.rotations import quaternion_from, rotation_from
from wbc.simulation.terrain import Terrain
from wbc.validate import Array
from wbc.view import palette
from wbc.view.live.messages import ControllerInfo
from wbc.view.live.shown_frame import ShownFrame
from wbc.view.solids import solid_surface

Colour = tuple[int, int, int]
BLACK, ORANGE, SKY, GREEN = (
    palette.rgb(one) for one in (palette.BLACK, palette.ORANGE, palette.SKY, palette.GREEN)
)
BLUE, VERMILION, PURPLE, GREY = (
    palette.rgb(one) for one in (palette.BLUE, palette.VERMILION, palette.PURPLE, palette.GREY)
)
PRINCIPAL = tuple(palette.rgb(one) for one in palette.PRINCIPAL)
AROUND = 64  # number of points of a circle
WORLD = "/world"  # the root node of all layers, moved so that the page follows the robot
THINNEST = 1e-3  # m: a flat ellipsoid is drawn this thick
PLANE = 2.0  # m: side of the square that is drawn for a half-space
Z = np.array([0.0, 0.0, 1.0])


class Context(NamedTuple):
    """What all layers have to do with."""

    scene: SceneApi  # to draw in
    size: float  # of the robot [m]
    robot: Robot
    terrain: Terrain


class Layer(ABC):
    """A part of the scene below one node, which can be hidden."""

    label: str  # its name on the page

    def __init__(self, context: Context) -> None:
        self.scene, self.size, self.robot, self.terrain = context
        self.path = f"{WORLD}/" + self.label.lower().replace(" ", "_")
        self.root = self.scene.add_frame(self.path, show_axes=False)

    def cast(self, cast: ControllerInfo) -> None:  # noqa: B027 - most layers do not care
        """Adapt to another controller, or to other contacts."""

    def lines(self, name: str, colour: Colour, thickness: float, visible: bool = True) -> Any:
        """Return a node of straight lines; thickness as a fraction of the robot's size."""
        points = np.zeros((1, 2, 3))
        return self.scene.add_line_segments(
            f"{self.path}/{name}", points, colour, thickness=thickness * self.size, visible=visible
        )

    def arrows(self, name: str, colour: Colour, shaft: float, head: float, length: float) -> Any:
        """Return a node of arrows, hidden without points; sizes are fractions of the robot's."""
        return self.scene.add_arrows(
            f"{self.path}/{name}",
            np.zeros((1, 2, 3)),
            colour,
            shaft_radius=shaft * self.size,
            head_radius=head * self.size,
            head_length=length * self.size,
            visible=False,
        )

    def rings(self, name: str, colour: Colour, thickness: float) -> Any:
        """Return a node of the unit sphere's three principal circles; thickness in pixels."""
        ring = circle()
        circles = np.concatenate([closed(np.roll(ring, shift, axis=1)) for shift in range(3)])
        return self.scene.add_line_segments(
            f"{self.path}/{name}", circles, colour, thickness=thickness, thickness_units="screen"
        )

    def mesh(self, name: str, surface: Triangles | Mesh, colour: Colour, **looks: Any) -> Any:
        """Return a node of a surface that is seen from both sides."""
        path, vertices, faces = f"{self.path}/{name}", surface.vertices, surface.faces
        return self.scene.add_mesh_simple(
            path, vertices, faces, color=colour, side="double", **looks
        )

    @abstractmethod
    def show(self, shown: ShownFrame) -> None:
        """Draw a frame; called only while the layer is visible."""


def place_ellipsoid(node: Any, ellipsoid: Ellipsoid, centre: Array) -> None:
    """Make a unit sphere's node an ellipsoid about a centre (3,)."""
    a, b, c = np.maximum(ellipsoid.semi_axes, THINNEST).tolist()
    node.scale, node.position, node.wxyz = (a, b, c), centre, wxyz(ellipsoid.axes)


def wxyz(rotation: Array) -> Array:
    """Return the quaternion (4,), scalar first, of a rotation (3, 3)."""
    x, y, z, w = quaternion_from(rotation)
    return np.array([w, x, y, z])


def along(direction: Array) -> Array:
    """Return the quaternion (4,) of a rotation that turns z into a unit vector."""
    x, y, z = direction
    if z < -1.0 + 1e-9:
        return np.array([0.0, 1.0, 0.0, 0.0])
    half = np.array([1.0 + z, -y, x, 0.0])
    return half / np.linalg.norm(half)


def closed(points: Array) -> Array:
    """Return the segments (k, 2, 3) of a closed curve through points (k, 3)."""
    return np.stack([points, np.roll(points, -1, axis=0)], axis=1)


def circle() -> Array:
    """Return points (k, 3) of the unit circle in the x-y plane."""
    angles = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    return np.column_stack([np.cos(angles), np.sin(angles), np.zeros(AROUND)])


def surface_of(shape: Shape) -> Triangles:
    """Return the surface of a collision shape; of a half-space a square about its own origin."""
    if isinstance(shape, Capsule):
        return _capsule(shape)
    return solid_surface(shape, np.zeros(3), 0.5 * PLANE, -0.5 * PLANE)


def _capsule(shape: Capsule) -> Triangles:
    """Return a capsule's surface, smooth around its own axis."""
    start, end = shape.ends
    length = float(np.linalg.norm(end - start))
    around_z = rounded_cylinder(shape.radius, 0.5 * length)
    w, x, y, z = along((end - start) / length if length > 0.0 else Z)
    R = rotation_from(np.array([x, y, z, w]))
    return Triangles(around_z.vertices @ R.T + 0.5 * (start + end), around_z.faces)
