"""The ground of the page, and marks on it, against the terrain they are on; rotations of layers."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import wbc
from tests.view.live.conftest import Stage, balanced, rotation_of
from wbc.problem.simulation_spec import rotated_to_plane
from wbc.simulation import Step, Terrain
from wbc.validate import Array
from wbc.view.live.layers.layer import ORANGE, WORLD, wxyz
from wbc.view.live.messages import Frame

BOARD = Step(centre=(1.0, 0.0, 0.15), size=(0.6, 0.8, 0.02))
TERRAIN = Terrain(slope=(0.1, -0.05), steps=(BOARD,))


@pytest.fixture
def hill(stages: Callable[..., Stage]) -> Stage:
    return stages(terrain=TERRAIN)


@pytest.fixture(scope="module")
def start(robot: wbc.Robot) -> Array:
    """Standing on the slope."""
    return rotated_to_plane(robot.posture("standing"), TERRAIN.normal)


def test_the_grid_is_tilted_and_boards_are_where_they_are(hill: Stage) -> None:
    grid = hill.handle("/ground/grid")
    turn = rotation_of(grid)
    np.testing.assert_allclose(turn[:, 2] @ (1.0, 0.0, 0.1), 0.0, atol=1e-12)
    np.testing.assert_allclose(turn[:, 2] @ (0.0, 1.0, -0.05), 0.0, atol=1e-12)
    assert turn[2, 2] > 0.9
    board = hill.handle("/ground/board 0").vertices
    np.testing.assert_allclose(board.min(axis=0), (0.7, -0.4, 0.13), atol=1e-6)
    np.testing.assert_allclose(board.max(axis=0), (1.3, 0.4, 0.15), atol=1e-6)


def test_level_ground_is_level(stage: Stage) -> None:
    np.testing.assert_allclose(stage.handle("/ground/grid").wxyz, (1.0, 0.0, 0.0, 0.0))
    assert stage.server.scene.get_handle_by_name(f"{WORLD}/ground/board 0") is None


def test_marks_lie_on_the_slope(hill: Stage, robot: wbc.Robot, start: Array) -> None:
    standing = hill.show(balanced(robot, q=start), start)
    polygon = hill.handle("/soles_and_support/polygon").points.reshape(-1, 3)
    mark = hill.handle("/com/projection").position
    plumb = hill.handle("/com/plumb").points[0]
    cop = hill.handle("/leg_cop_cmp/cop").position
    for points in (polygon, mark[None], plumb[1:], cop[None]):
        above = points @ (-0.1, 0.05, 1.0)
        assert (above > -1e-6).all() and (above < 2e-3).all()
    np.testing.assert_allclose(cop[:2], standing.com[:2], atol=1e-9)
    leg = hill.handle("/leg_cop_cmp/leg").points[0]
    np.testing.assert_allclose(leg[0], cop, atol=1e-6)


def test_feet_stand_on_slopes_and_boards_without_a_controller(hill, robot, start) -> None:
    level = robot.posture("standing")
    level[[0, 2]] += (1.0, 0.15)
    flying = level + np.eye(robot.nq)[2] * 0.03
    for k, (q, stands) in enumerate(((start, True), (level, True), (flying, False))):
        hill.draw(Frame(float(k), q, np.zeros(robot.nv)))
        for foot in robot.feet:
            colour = tuple(hill.handle(f"/soles_and_support/{foot}").colors.ravel()[:3])
            assert (colour == ORANGE) == stands
        mark = hill.handle("/com/projection")
        assert mark.visible == stands
        if q is level:
            assert mark.position[2] == pytest.approx(0.15, abs=2e-3)


def test_quaternions_are_scipys_up_to_their_sign() -> None:
    for turn in Rotation.random(50, rng=np.random.default_rng(0)):
        x, y, z, w = turn.as_quat()
        assert abs(wxyz(turn.as_matrix()) @ [w, x, y, z]) > 1.0 - 1e-12
    half = Rotation.from_rotvec([np.pi, 0.0, 0.0])  # the scalar vanishes
    np.testing.assert_allclose(np.abs(wxyz(half.as_matrix())), [0.0, 1.0, 0.0, 0.0], atol=1e-12)
