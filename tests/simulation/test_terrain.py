"""The surface of a terrain, and terrains as plain data."""

import json

import numpy as np
import pytest

from wbc.robot import Robot
from wbc.simulation import Plant, Step, Terrain
from wbc.simulation.terrain import LEVEL

# A board, turned by a quarter: 0.4 m along the world's x, 0.2 m along y.
BOARD = Step(centre=(1.0, 0.5, 0.3), size=(0.2, 0.4, 0.1), yaw=0.5 * np.pi, friction=0.5)
SLOPED = Terrain(friction=0.4, slope=(0.1, -0.2), steps=(BOARD,), time_constant=0.02, drift=True)


def test_the_surface_is_the_plane_and_the_boards_on_it() -> None:
    points = np.array(((0.0, 0.0), (2.0, 1.0), (1.19, 0.59), (1.21, 0.5), (1.0, 0.61)))
    surface = SLOPED.surface(points)
    np.testing.assert_array_equal(surface[:, :2], points)
    on_plane = 0.1 * points[:, 0] - 0.2 * points[:, 1]
    wanted = np.where([False, False, True, False, False], 0.3, on_plane)
    np.testing.assert_allclose(surface[:, 2], wanted, rtol=0, atol=1e-15)
    above = np.column_stack((points, np.full(5, 7.0)))  # a height that points have does not matter
    np.testing.assert_array_equal(SLOPED.surface(above), surface)


def test_upright_tells_how_far_a_point_is_above_the_plane() -> None:
    point = np.array((2.0, 1.0, 5.0))
    assert SLOPED.upright @ point == pytest.approx(5.0)  # 0.2 - 0.2 below it
    foot = point - (SLOPED.upright @ point) * np.array((0.0, 0.0, 1.0))
    assert SLOPED.normal @ foot == pytest.approx(0.0, abs=1e-15)
    assert np.linalg.norm(SLOPED.normal) == pytest.approx(1.0)


@pytest.mark.parametrize("terrain", [LEVEL, SLOPED])
def test_plain_data_come_back(terrain: Terrain) -> None:
    data = json.loads(json.dumps(terrain.to_data()))
    found = Terrain.from_data(data)
    assert found.to_data() == terrain.to_data() == data
    assert len(found.steps) == len(terrain.steps)
    for mine, other in zip(found.steps, terrain.steps, strict=True):
        np.testing.assert_array_equal(mine.centre, other.centre)
        np.testing.assert_array_equal(mine.size, other.size)
        assert (mine.yaw, mine.friction) == (other.yaw, other.friction)


def test_a_tilted_board_is_where_mujoco_has_it(hoap2: Robot) -> None:
    """By rays from above, on and beside the board."""
    import mujoco

    board = Step((0.6, -0.2, 0.15), (0.5, 0.3, 0.1), yaw=0.4, slope=(0.2, -0.3))
    terrain = Terrain(steps=(board,))
    plant = Plant(hoap2, terrain=terrain)
    model, data = plant.model, plant.data
    mujoco.mj_forward(model, data)
    points = np.random.default_rng(0).uniform((0.2, -0.6), (1.0, 0.2), size=(200, 2))
    group, hit = np.ones(6, dtype=np.uint8), np.zeros(1, dtype=np.int32)
    found = []
    for x, y in points.tolist():
        start, down = np.array((x, y, 2.0)), np.array((0.0, 0.0, -1.0))
        found.append(2.0 - mujoco.mj_ray(model, data, start, down, group, 1, -1, hit))
    on = terrain.height(points) > 0.0
    assert 30 < on.sum() < 170
    # A side of the board that leans out hides a little of the ground, which height() does not.
    same = np.isclose(terrain.height(points), found, atol=1e-9)
    assert same[on].all() and same.mean() > 0.9
