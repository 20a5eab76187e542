"""The view follows the robot: what is drawn at the page's origin, and what that changes."""

from collections.abc import Callable

import numpy as np
import pytest

import wbc
from tests.view.live.conftest import Stage, client_of, rotation_of, tell
from wbc.simulation import Terrain
from wbc.validate import Array
from wbc.view.live.camera_following import FREE_RADIUS, TIME_CONSTANT, TIME_GAP
from wbc.view.live.layers.robot import RobotShapes
from wbc.view.live.messages import Frame

SLOPE = (0.1, -0.05)


@pytest.fixture
def hill(stages: Callable[..., Stage]) -> Stage:
    return stages(terrain=Terrain(slope=SLOPE))


def show(stage: Stage, robot: wbc.Robot, time: float, x: float, y: float = 0.0) -> Array:
    """Draw the standing robot, moved; return its CoM."""
    q = robot.posture("standing")
    q[:2] += (x, y)
    stage.draw(Frame(time, q, np.zeros(robot.nv)))
    return robot.snapshot(q).com


def size_of(robot: wbc.Robot) -> float:
    """Return the robot's size [m], as the page counts it."""
    low, high = RobotShapes(robot).extent(robot, robot.posture())
    return float(np.max(high - low))


def origin(stage: Stage) -> Array:
    """Return the world's point that is drawn at the page's origin."""
    return -np.asarray(stage.handle("").position)


def tick_box(stage: Stage, value: bool) -> None:
    """Tick the box, as a browser does."""
    box = stage.gui("Follow the robot")
    with client_of(stage.url) as client:
        tell(client, "GuiUpdateMessage", uuid=box._impl.uuid, updates={"value": value})
        for _ in range(400):
            if box.value == value and stage.page._changed:
                break
            client.ping().wait(0.05)
    assert box.value == value


def test_a_robot_far_away_is_at_the_pages_origin(stage: Stage, robot: wbc.Robot) -> None:
    com = show(stage, robot, 0.0, 3.0, -2.0)
    np.testing.assert_allclose(origin(stage), [com[0], com[1], 0.0], atol=1e-12)
    np.testing.assert_allclose(stage.handle("/com/com").position, com)  # in the world's axes


def test_a_robot_that_stands_moves_nothing(stage: Stage, robot: wbc.Robot) -> None:
    half = 0.5 * FREE_RADIUS * size_of(robot)
    for k in range(20):
        show(stage, robot, 0.1 * k, half * np.sin(k), half * np.cos(k))
        np.testing.assert_array_equal(origin(stage), 0.0)
        np.testing.assert_array_equal(stage.handle("/ground/grid").position, 0.0)


def test_it_is_a_little_behind_a_walk_and_sways_less(stage: Stage, robot: wbc.Robot) -> None:
    """Behind by the slack and, as a first-order lag, by the speed times its time constant."""
    following, slack = stage.page._following, FREE_RADIUS * size_of(robot)
    speed, sway, period, dt = 0.3, 0.02, 1.0, 0.04
    points = []
    for t in dt * np.arange(500):
        com = np.array([speed * t, sway * np.sin(2.0 * np.pi * t / period), 0.5])
        following.follow(com, t)
        points.append(following.point)
    last = np.array(points[-100:])
    behind = speed * dt * np.arange(400, 500) - last[:, 0]
    assert np.mean(behind) == pytest.approx(slack + speed * TIME_CONSTANT, rel=0.1)
    assert np.ptp(behind) < 0.02
    assert np.ptp(last[:, 1]) < 0.5 * 2.0 * sway
    np.testing.assert_array_equal(last[:, 2], 0.0)


def test_a_restart_and_a_jump_are_not_glided_over(stage: Stage, robot: wbc.Robot) -> None:
    show(stage, robot, 0.0, 0.0)
    com = show(stage, robot, 2.0 * TIME_GAP, 2.0)
    np.testing.assert_allclose(origin(stage)[:2], com[:2], atol=1e-12)
    show(stage, robot, 0.0, 0.0)
    np.testing.assert_array_equal(origin(stage), 0.0)


def test_without_the_box_the_view_stays(stage: Stage, robot: wbc.Robot) -> None:
    com = show(stage, robot, 0.0, 1.0)
    tick_box(stage, False)
    for time in (0.1, 0.2, 10.0, 0.0):
        far = show(stage, robot, time, 3.0 + time)
        np.testing.assert_allclose(origin(stage)[:2], com[:2], atol=1e-12)
    tick_box(stage, True)
    stage.draw()  # the same frame: the run may pause
    np.testing.assert_allclose(origin(stage)[:2], far[:2], atol=1e-12)


def test_up_a_slope_the_point_is_on_it(hill: Stage, robot: wbc.Robot) -> None:
    com = show(hill, robot, 0.0, 3.0, -2.0)
    np.testing.assert_allclose(origin(hill), [com[0], com[1], com[:2] @ SLOPE], atol=1e-12)


@pytest.mark.parametrize("where", [(3.03, -2.18), (40.0, 7.7)])
def test_the_grid_goes_along_and_its_lines_stay(hill, robot, where: tuple[float, float]) -> None:
    show(hill, robot, 0.0, *where)
    grid = hill.handle("/ground/grid")
    turn = rotation_of(grid)
    along, from_point = turn.T @ grid.position, turn.T @ (grid.position - origin(hill))
    section = grid.section_size
    assert np.abs(from_point[:2]).max() <= 0.5 * section + 1e-9
    np.testing.assert_allclose(from_point[2], 0.0, atol=1e-9)
    np.testing.assert_allclose(along[:2] / section, np.round(along[:2] / section), atol=1e-9)
