"""M omega d, and the height of the ground."""

from copy import deepcopy

import numpy as np
import pytest

from wbc.constraints.com_support import support_polygon
from wbc.errors import InvalidInputError
from wbc.polygon import polygon_margin
from wbc.robot import Robot
from wbc.simulation import Step, Terrain, capture_impulse


def test_it_moves_the_capture_point_to_the_edge(load) -> None:
    robot: Robot = load("hoap2_like")
    here, feet = robot.snapshot(robot.posture("standing")), ("left", "right")
    polygon = support_polygon(here, feet)
    ground = here.position(robot.foot("left").frame)[2]
    omega = np.sqrt(9.81 / (here.com[2] - ground))
    for angle in np.linspace(0.0, 2.0 * np.pi, 9):
        u = np.array((np.cos(angle), np.sin(angle)))
        impulse = capture_impulse(here, feet, 7.0 * u)
        point = here.com[:2] + impulse / (robot.mass * omega) * u
        np.testing.assert_allclose(polygon_margin(polygon, point), 0.0, atol=1e-12)
    with pytest.raises(InvalidInputError, match="outside the soles"):
        capture_impulse(here, ("left",), (1.0, 0.0))  # between the feet


def test_the_robot_s_own_gravity_counts(load) -> None:
    """M omega d goes with the root of gravity; a plant takes it from the model too."""
    earth = load("hoap2_like")
    moon = deepcopy(earth)
    moon.model.gravity.linear = np.array((0.0, 0.0, -earth.gravity / 4.0))
    impulses = [
        capture_impulse(robot.snapshot(robot.posture("standing")), ("left", "right"), (1.0, 0.0))
        for robot in (earth, moon)
    ]
    assert impulses[1] == pytest.approx(0.5 * impulses[0], rel=1e-12)
    assert moon.weight == pytest.approx(0.25 * earth.weight, rel=1e-12)


def test_a_direction_along_the_ground_is_needed(load) -> None:
    robot = load("hoap2_like")
    with pytest.raises(InvalidInputError, match="needs a part along the ground"):
        capture_impulse(robot.snapshot(robot.posture("standing")), ("left", "right"), (0, 0, 1.0))


def test_height_of_slope_and_steps() -> None:
    step = Step(np.array((1.0, 0.0, 0.2)), np.array((0.4, 0.2, 0.2)), yaw=np.pi / 2)
    terrain = Terrain(slope=(0.1, -0.2), steps=(step,))
    points = np.array(((0.0, 0.0), (2.0, 1.0), (1.0, 0.19), (1.19, 0.0), (1.09, -0.19)))
    np.testing.assert_allclose(terrain.height(points), [0.0, 0.0, 0.2, 0.119, 0.2], atol=1e-15)
    # as the plane's normal has it
    (z,) = terrain.height(np.array(((3.0, 4.0),)))
    assert terrain.normal @ (3.0, 4.0, z) == pytest.approx(0.0, abs=1e-15)
