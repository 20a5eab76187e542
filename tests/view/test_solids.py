"""Meshes for pictures: the boards of a terrain, and simpler ones."""

import numpy as np
import pytest

from wbc.gait.walls import WALL_THICKNESS, Wall
from wbc.robot.formats.triangles import Triangles
from wbc.robot.geometry import Mesh, ellipsoid
from wbc.simulation import Step, Terrain
from wbc.validate import Array
from wbc.view.solids import board_surfaces, limit_triangles, simplified

STEP = Step(centre=(1.0, 0.5, 0.3), size=(0.2, 0.4, 0.1), yaw=0.3)
TERRAIN = Terrain(steps=(STEP, Step(centre=(9.0, 0.0, 0.02), size=(0.6, 2.0, 0.02))))
BALL = ellipsoid(np.array([0.3, 0.2, 0.1]))
MESH = Mesh("ball", BALL.vertices, BALL.faces, (1.0, 0.0, 0.0))


def local(points: Array) -> Array:
    """World points (k, 3) in the axes of the first step, from the middle of its upper face."""
    c, s = np.cos(0.3), np.sin(0.3)
    x, y, z = (points - STEP.centre).T
    return np.column_stack((c * x + s * y, c * y - s * x, z))


def volume(surface: Triangles) -> float:
    """Enclosed by triangles of any winding around their middle [m^3]."""
    corners = (surface.vertices - surface.vertices.mean(axis=0))[surface.faces]
    return float(np.abs(np.linalg.det(corners)).sum() / 6.0)


def test_they_are_the_boxes() -> None:
    first, second = board_surfaces(TERRAIN)
    corners = local(first.vertices)
    assert len(corners) == 8
    np.testing.assert_allclose(np.abs(corners[:, :2]), [[0.1, 0.2]] * 8, atol=1e-12)
    np.testing.assert_allclose(np.sort(corners[:, 2]), [-0.1] * 4 + [0.0] * 4, atol=1e-12)
    assert volume(first) == pytest.approx(0.2 * 0.4 * 0.1)
    np.testing.assert_allclose(second.vertices.min(axis=0), [8.7, -1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(second.vertices.max(axis=0), [9.3, 1.0, 0.02], atol=1e-12)


def test_only_what_is_near_is_made() -> None:
    around = STEP.centre + (0.3 * np.cos(0.3), 0.3 * np.sin(0.3), 0.0)  # 0.3 m along the step's x
    (near,) = board_surfaces(TERRAIN, around, 0.25)
    corners = local(near.vertices)
    np.testing.assert_allclose(corners.min(axis=0), [0.05, -0.2, -0.1], atol=1e-12)
    np.testing.assert_allclose(corners.max(axis=0), [0.1, 0.2, 0.0], atol=1e-12)
    assert board_surfaces(TERRAIN, np.array((-5.0, 0.0)), 0.5) == []


def test_what_of_a_wall_is_near_is_made() -> None:
    wall = Wall(point=(2.0, 0.0, 0.0), normal=(-1.0, 0.0, 0.0), size=(3.0, 2.0))
    (whole,) = board_surfaces(Terrain(walls=(wall,)))
    size = np.ptp(whole.vertices, axis=0)
    np.testing.assert_allclose(size, [WALL_THICKNESS, 3.0, 2.0], atol=1e-12)
    assert whole.vertices[:, 0].min() == pytest.approx(2.0)  # it is behind its face
    (near,) = board_surfaces(Terrain(walls=(wall,)), np.array((0.0, 1.2)), 0.5)
    np.testing.assert_allclose(np.sort(np.unique(near.vertices[:, 1].round(9))), [0.7, 1.5])
    assert board_surfaces(Terrain(walls=(wall,)), np.array((0.0, 5.0)), 0.5) == []


@pytest.mark.slow
@pytest.mark.parametrize("cell", [0.01, 0.03, 0.1])
def test_no_corner_moves_farther_than_a_cell(cell: float) -> None:
    made = simplified(MESH, cell)
    assert len(made.faces) < len(MESH.faces)
    apart = np.linalg.norm(made.vertices[:, None] - MESH.vertices[None], axis=-1).min(axis=1)
    assert apart.max() <= np.sqrt(3.0) * cell
    assert set(made.faces.ravel()) == set(range(len(made.vertices)))
    a, b, c = made.vertices[made.faces].transpose(1, 0, 2)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 0.0
    assert (made.name, made.colour) == (MESH.name, MESH.colour)


def test_what_would_vanish_stays() -> None:
    inside = Mesh("ball", MESH.vertices + 5.0, MESH.faces, MESH.colour)  # of one cell
    assert simplified(inside, 10.0) is inside


def test_the_finest_grid_that_will_do() -> None:
    assert limit_triangles([MESH], len(MESH.faces))[0] is MESH
    few = limit_triangles([MESH, MESH], 3000)
    count = sum(len(mesh.faces) for mesh in few)
    assert 1000 < count <= 3000
