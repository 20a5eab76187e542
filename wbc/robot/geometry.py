"""The shapes of a robot as triangles in the world, for drawing."""

from __future__ import annotations

from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from wbc.robot.formats.triangles import BOX_CORNERS, Triangles
from wbc.robot.model import Robot
from wbc.validate import Array, Index, read_only

# Around an axis: a chord is at most 0.05 % of the radius inside the circle; and from pole to pole.
VERTICES_AROUND, VERTICES_ALONG = 96, 48


@dataclass(frozen=True, eq=False)
class Mesh:
    """One shape of a link."""

    name: str  # the link
    vertices: Array  # (k, 3) [m], read-only
    # Triangles (m, 3) as indices of vertices, read-only. Their winding is the file's and may be
    # either.
    faces: Index
    colour: tuple[float, float, float]  # red, green, blue in [0, 1], as the file says

    def __post_init__(self) -> None:
        read_only(self.vertices)
        self.faces.flags.writeable = False


class RobotMeshes:
    """The triangles of a robot, made once and placed at any configuration.

    The visual shapes, or the collision shapes of a robot that has none. Fully transparent shapes
    and planes are left out.

    Raises ModelError: a mesh file cannot be read.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        surfaces = robot.visual_surfaces
        if not surfaces.shapes.ngeoms:
            surfaces = robot.collision_surfaces
        placed = [
            _in_joint_frame(robot.model, shape, surfaces.meshes.get(shape.name))
            for shape in surfaces.shapes.geometryObjects
        ]
        self._meshes = [(joint, mesh) for joint, mesh in placed if len(mesh.faces)]

    @property
    def in_joint_frames(self) -> list[tuple[int, Mesh]]:
        """Pinocchio's index of the joint that moves a mesh, and the mesh in that joint's frame."""
        return list(self._meshes)

    def at(self, q: ArrayLike) -> list[Mesh]:
        """Return the meshes in the world at configuration ``q`` (nq,)."""
        R, p = self._robot.snapshot(q).joint_placements
        return [_moved(mesh, R[joint], p[joint]) for joint, mesh in self._meshes]


def _in_joint_frame(
    model: pin.Model, shape: pin.GeometryObject, read: Triangles | None
) -> tuple[int, Mesh]:
    red, green, blue, alpha = (float(value) for value in shape.meshColor)
    surface = (read or triangulated(shape.geometry)) if alpha > 0.0 else _NOTHING
    link, pose = str(model.frames[shape.parentFrame].name), shape.placement
    mesh = Mesh(link, *surface, (red, green, blue))
    return int(shape.parentJoint), _moved(mesh, pose.rotation, pose.translation)


def _moved(mesh: Mesh, rotation: Array, origin: Array) -> Mesh:
    vertices = mesh.vertices @ rotation.T + origin
    return Mesh(mesh.name, vertices, mesh.faces, mesh.colour)


_NOTHING = Triangles(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))


def triangulated(shape: object) -> Triangles:
    """Return the surface of a ``coal`` shape, or triangles, in its own frame; empty if none."""
    match shape:
        case Triangles():
            return shape
        case coal.Box():
            return box(np.asarray(shape.halfSide))
        case coal.Sphere():
            return ellipsoid(np.full(3, shape.radius))
        case coal.Ellipsoid():
            return ellipsoid(np.asarray(shape.radii))
        case coal.Capsule():
            return rounded_cylinder(shape.radius, shape.halfLength)
        case coal.Cylinder():
            return cylinder(shape.radius, shape.halfLength)
        case coal.Cone():
            return cone(shape.radius, shape.halfLength)
        case coal.Convex():
            triangles = [shape.polygons(k) for k in range(shape.num_polygons)]
            return Triangles(np.array(shape.points()), _indices(triangles))
        case coal.BVHModelBase():
            triangles = [shape.tri_indices(k) for k in range(shape.num_tris)]
            return Triangles(np.array(shape.vertices()), _indices(triangles))
    return _NOTHING


def _indices(triangles: list[coal.Triangle]) -> Index:
    corners = [(triangle[0], triangle[1], triangle[2]) for triangle in triangles]
    return np.array(corners, dtype=np.int64).reshape(-1, 3)


def box(half: Array) -> Triangles:
    """Return a box centred at the origin, with half side lengths (3,)."""
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))]
    return Triangles(BOX_CORNERS * half, np.array(faces, dtype=np.int64))


def cylinder(radius: float, half_length: float) -> Triangles:
    """Return a closed cylinder around z."""
    ends = np.array([-half_length, -half_length, half_length, half_length])
    return _revolved(np.array([0.0, radius, radius, 0.0]), ends)


def cone(radius: float, half_length: float) -> Triangles:
    """Return a closed cone around z, its apex at the upper end."""
    ends = np.array([-half_length, -half_length, half_length])
    return _revolved(np.array([0.0, radius, 0.0]), ends)


def rounded_cylinder(radius: float, half_length: float) -> Triangles:
    """Return a capsule around z: a cylinder with a half ball on either end."""
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, VERTICES_ALONG + 2)  # none of them 0
    heights = radius * np.sin(angles) + np.copysign(half_length, angles)
    return _revolved(radius * np.cos(angles), heights)


def ellipsoid(radii: Array) -> Triangles:
    """Return an ellipsoid centred at the origin, with semi-axes (3,) along x, y, z."""
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, VERTICES_ALONG + 1)
    ball = _revolved(np.cos(angles), np.sin(angles))
    return Triangles(ball.vertices * radii, ball.faces)


def _revolved(radii: Array, heights: Array) -> Triangles:
    """Return the surface that points (radius, height), from the bottom up, sweep around z."""
    angles = np.linspace(0.0, 2.0 * np.pi, VERTICES_AROUND, endpoint=False)
    x, y = np.outer(radii, np.cos(angles)), np.outer(radii, np.sin(angles))  # rings
    z = np.broadcast_to(heights[:, None], x.shape)
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    first = np.arange((len(radii) - 1) * VERTICES_AROUND).reshape(-1, VERTICES_AROUND)
    last = np.roll(first, -1, axis=1)
    lower = np.stack([first, last, last + VERTICES_AROUND], axis=-1)
    upper = np.stack([first, last + VERTICES_AROUND, first + VERTICES_AROUND], axis=-1)
    return Triangles(vertices, np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)]))
