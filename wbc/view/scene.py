"""What is in a picture: robot, ellipsoid and ground, and the curves drawn about them [m]."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wbc.rmp.ellipsoid import Ellipsoid
from wbc.robot import Foot, Snapshot
from wbc.robot.geometry import Mesh
from wbc.simulation.terrain import LEVEL, Terrain
from wbc.validate import Array
from wbc.view import palette
from wbc.view.solids import board_surfaces

SPREAD = 0.9  # of what is in the picture: how far around it boards are drawn; the rest has faded


@dataclass(frozen=True, eq=False)
class Scene:
    """What is drawn, in world coordinates."""

    meshes: Sequence[Mesh]  # the robot; empty if its description holds no shapes
    # ellipsoid and centre: its equimomental ellipsoid in world axes, and the CoM (3,) [m].
    ellipsoid: Ellipsoid
    centre: Array
    tint: Array  # colour of the ellipsoid, (3,) in [0, 1]
    ground: float  # altitude of the ground at the world's origin [m]
    grounded: bool = True  # whether there is a ground to draw; a floating robot has none
    glass: bool = True  # whether the ellipsoid is drawn
    solids: Sequence[Mesh] = ()  # obstacles; what is behind them shows through a little
    terrain: Terrain = LEVEL  # the ground's slope, and the boards on it
    scale: float | None = None  # the size of a robot, where there are several [m]

    @cached_property
    def corners(self) -> Array:
        """Triangles (m, 3, 3): triangle, corner, coordinate [m]."""
        return triangles(self.meshes)

    @cached_property
    def colours(self) -> Array:
        """Colour of each triangle (m, 3)."""
        return colours(self.meshes)

    @property
    def solid_corners(self) -> Array:
        """Triangles (m, 3, 3) of the obstacles [m]."""
        return triangles(self.solids)

    @property
    def size(self) -> float:
        """What lengths in the picture go by [m]."""
        return self.spread if self.scale is None else self.scale

    @cached_property
    def spread(self) -> float:
        """The largest extent of what there is, along x, y or z [m]."""
        reach = float(self.ellipsoid.semi_axes.max())
        points = self.corners.reshape(-1, 3)
        low = points.min(axis=0, initial=np.inf)
        high = points.max(axis=0, initial=-np.inf)
        low, high = np.minimum(low, self.centre - reach), np.maximum(high, self.centre + reach)
        return float((high - low).max())

    @cached_property
    def boards(self) -> Sequence[Mesh]:
        """What is near of the boards on the ground."""
        colour = palette.unit_rgb(palette.BOARD)
        surfaces = board_surfaces(self.terrain, self.centre, SPREAD * self.spread)
        risen = np.array([0.0, 0.0, self.ground])
        return [Mesh("", one.vertices + risen, one.faces, colour) for one in surfaces]

    def above_plane(self, points: Array) -> Array:
        """Return how far points (..., 3) are above the ground's plane, vertically [m]."""
        return points @ self.terrain.upright - self.ground

    @property
    def below_centre(self) -> Array:
        """The point of the ground's plane under the CoM (3,)."""
        x, y, _ = self.centre
        return np.array([x, y, self.ground + float(self.centre[:2] @ self.terrain.slope)])

    @property
    def stood_on(self) -> Array:
        """The point of the ground, or of a board on it, under the CoM (3,)."""
        return self.terrain.surface(self.centre[None])[0] + [0.0, 0.0, self.ground]

    @property
    def extent(self) -> Array:
        """Points (k, 3) that a picture must contain, relative to :attr:`below_centre`."""
        sections = principal_sections(self.ellipsoid, self.centre)
        vertices = [mesh.vertices for mesh in self.meshes]
        return np.concatenate([*vertices, *sections, self.below_centre[None]]) - self.below_centre


def triangles(meshes: Sequence[Mesh]) -> Array:
    """Return the corners (m, 3, 3) of all triangles of meshes."""
    return np.concatenate([np.empty((0, 3, 3)), *(mesh.vertices[mesh.faces] for mesh in meshes)])


def colours(meshes: Sequence[Mesh]) -> Array:
    """Return the colour (m, 3) of each triangle of meshes."""
    parts = [np.tile(mesh.colour, (len(mesh.faces), 1)) for mesh in meshes]
    return np.concatenate([np.empty((0, 3)), *parts])


# ---------------------------------------------------------------------- curves

POINTS = 181
THINNEST = 1e-9  # m: a flat ellipsoid has this


def surface_points(ellipsoid: Ellipsoid, centre: Array, directions: Array) -> Array:
    """Return the points (k, 3) of the ellipsoid's surface that unit vectors (k, 3) are mapped to.

    The unit ball is stretched along the coordinate axes by the semi-axes, then turned.
    """
    return centre + directions * ellipsoid.semi_axes @ ellipsoid.axes.T


def principal_sections(ellipsoid: Ellipsoid, centre: Array) -> Array:
    """Return three closed curves (3, k, 3) on the surface: section n is across axis n."""
    circles = np.zeros((3, POINTS, 3))
    ring = _ring()
    for across in range(3):
        circles[across][:, [(across + 1) % 3, (across + 2) % 3]] = ring
    return np.stack([surface_points(ellipsoid, centre, circle) for circle in circles])


def silhouette(ellipsoid: Ellipsoid, centre: Array, eye: Array) -> Array:
    """Return the outline (k, 3) of the ellipsoid as seen from ``eye``, which is outside it.

    Where the ellipsoid is the unit ball and the eye is at e, the points x that the eye sees edge-on
    have x . (x - e) = 0 and |x| = 1: the circle x . e = 1.
    """
    start = (eye - centre) @ ellipsoid.axes / np.maximum(ellipsoid.semi_axes, THINNEST)
    square = float(start @ start)
    across = np.linalg.svd(start[None])[2][1:]  # (2, 3) orthonormal, orthogonal to the eye's ray
    circle = start / square + np.sqrt(max(0.0, 1.0 - 1.0 / square)) * _ring() @ across
    return surface_points(ellipsoid, centre, circle)


def sole_outline(snapshot: Snapshot, foot: Foot) -> Array:
    """Return the closed outline (k, 3) of a foot's sole."""
    corners = sole_corners(snapshot, foot)
    return densified(np.concatenate([corners, corners[:1]]))


def sole_corners(snapshot: Snapshot, foot: Foot) -> Array:
    """Return the corners (k, 3) of a foot's sole."""
    flat = np.column_stack([foot.polygon, np.zeros(len(foot.polygon))])
    rotation, origin = snapshot.rotation(foot.frame), snapshot.position(foot.frame)
    return np.asarray(flat @ rotation.T + origin)


def densified(corners: Array) -> Array:
    """Return points (k, 3) along the straight lines between corners (n, 3), 20 on each."""
    steps = np.arange(20)[:, None, None] / 20.0
    points = corners[:-1] + steps * (corners[1:] - corners[:-1])  # (20, n-1, 3)
    return np.concatenate([points.transpose(1, 0, 2).reshape(-1, 3), corners[-1:]])


def _ring() -> Array:
    angles = np.linspace(0.0, 2.0 * np.pi, POINTS)
    return np.column_stack([np.cos(angles), np.sin(angles)])
