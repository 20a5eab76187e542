"""Simpler meshes stay where they were."""

import numpy as np
import pytest

from wbc.robot.geometry import Mesh, ellipsoid
from wbc.view.simplify import limit_triangles, simplified

BALL = ellipsoid(np.array([0.3, 0.2, 0.1]))
MESH = Mesh("ball", BALL.vertices, BALL.faces, (1.0, 0.0, 0.0))


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
