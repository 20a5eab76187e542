"""Obstacles, and steps and walls of a terrain, as triangles; and meshes with fewer."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import ConvexHull

from wbc.gait.walls import WALL_THICKNESS, Wall
from wbc.robot.collision import HalfSpace, Hull, Shape
from wbc.robot.formats.triangles import Triangles
from wbc.robot.geometry import Mesh
from wbc.simulation.terrain import Step, Terrain
from wbc.validate import Array

AROUND = 24  # points around a rounded edge
ROUND = 1e-6  # m: less is not rounded
FINEST, GROWTH = 1e-3, 1.25  # m of the first grid tried, and how much coarser the next is


def solid_surface(shape: Shape, centre: Array, reach: float, ground: float) -> Triangles:
    """Return the triangles of a shape in its own frame.

    ``centre``: (3,) in that frame: a half-space, which has no end, is drawn as a square about the
    point of its surface nearest to it.
    ``reach``: half the side of that square [m].
    ``ground``: lowest height of an upright wall [m], in that frame.
    """
    if isinstance(shape, HalfSpace):
        return _pane(shape, centre, reach, ground)
    points = shape.core
    if shape.radius > ROUND:
        points = (points[:, None] + shape.radius * _sphere()).reshape(-1, 3)
    hull = ConvexHull(points)
    used, faces = np.unique(hull.simplices, return_inverse=True)
    return Triangles(points[used], faces.reshape(hull.simplices.shape))


def _pane(wall: HalfSpace, centre: Array, reach: float, ground: float) -> Triangles:
    normal = wall.normal
    middle = centre - (normal @ centre - wall.offset) * normal
    upright = abs(float(normal[2])) < 0.9
    along = np.cross(normal, (0.0, 0.0, 1.0) if upright else (1.0, 0.0, 0.0))
    along /= np.linalg.norm(along)
    up = np.cross(along, normal)
    up *= 1.0 if up[2] >= 0.0 else -1.0
    low = -reach
    if upright:
        low = max(low, (ground - float(middle[2])) / float(up[2]))
    square = ((-reach, low), (reach, low), (reach, reach), (-reach, reach))
    corners = [middle + a * along + b * up for a, b in square]
    return Triangles(np.array(corners), np.array(((0, 1, 2), (0, 2, 3))))


def _sphere() -> Array:
    """Return points of the unit sphere, its poles and the corners of rings of equal height."""
    heights = np.linspace(-1.0, 1.0, AROUND // 2 + 1) * 0.5 * np.pi
    angles = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    height, angle = np.meshgrid(heights, angles, indexing="ij")
    flat = np.cos(height)
    points = np.stack((flat * np.cos(angle), flat * np.sin(angle), np.sin(height)), axis=-1)
    return points.reshape(-1, 3)


ORIGIN = np.zeros(3)


def board_surfaces(
    terrain: Terrain, around: Array = ORIGIN, reach: float = math.inf
) -> list[Triangles]:
    """Return the triangles of the steps and walls of a terrain, in world axes.

    ``around``, ``reach``: a place (2,) or (3,) and how far from it [m], along the axes of each
    step: only what is in there is returned.
    """
    parts = [_within(step, around[:2], reach) for step in terrain.steps]
    parts += [_wall(wall, around[:2], reach) for wall in terrain.walls]
    return [part for part in parts if part is not None]


def _wall(wall: Wall, around: Array, reach: float) -> Triangles | None:
    """Return what of a wall is within reach, to the sides; None if nothing."""
    R, (width, height) = wall.rotation, wall.size.tolist()
    here = float((around - wall.point[:2]) @ R[:2, 1])
    low, high = max(-0.5 * width, here - reach), min(0.5 * width, here + reach)
    if low >= high:
        return None
    middle = (-0.5 * WALL_THICKNESS, 0.5 * (low + high), 0.0)
    box = Hull.box((WALL_THICKNESS, high - low, height), middle)
    surface = solid_surface(box, ORIGIN, 0.0, 0.0)
    return Triangles(surface.vertices @ R.T + wall.point, surface.faces)


def _within(step: Step, around: Array, reach: float) -> Triangles | None:
    """Return what a square has of a step; None if nothing."""
    here = (around - step.centre[:2]) @ step.axes
    half = 0.5 * step.size[:2]
    low, high = np.maximum(-half, here - reach), np.minimum(half, here + reach)
    if (low >= high).any():
        return None
    height = float(step.size[2])
    box = Hull.box((*(high - low), height), (*(0.5 * (low + high)), -0.5 * height))
    surface = solid_surface(box, ORIGIN, 0.0, 0.0)
    return Triangles(surface.vertices @ step.rotation.T + step.centre, surface.faces)


def simplified(mesh: Mesh, cell: float) -> Mesh:
    """Return a mesh whose corners within a cell of a grid are one, their mean.

    No corner moves farther than the cell's diagonal. Triangles that lose their area are left out;
    a mesh of which nothing would be left stays as it is.

    ``cell``: side of the grid's cells [m].
    """
    cells = np.floor(mesh.vertices / cell).astype(np.int64)
    _, group, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    means = np.zeros((len(counts), 3))
    np.add.at(means, group, mesh.vertices)
    means /= counts[:, None]
    faces = group[mesh.faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    faces = np.unique(np.sort(faces, axis=1), axis=0)  # either winding is allowed
    if not len(faces):
        return mesh
    used, faces = np.unique(faces, return_inverse=True)
    return Mesh(mesh.name, means[used], faces.reshape(-1, 3), mesh.colour)


def limit_triangles(meshes: list[Mesh], triangles: int) -> list[Mesh]:
    """Return meshes with at most so many triangles in all, on the finest grid that will do."""
    made, cell = meshes, FINEST
    while sum(len(mesh.faces) for mesh in made) > triangles and cell < 1.0:
        made = [simplified(mesh, cell) for mesh in meshes]
        cell *= GROWTH
    return made
