"""Contact forces as drawn, against the controller's own and against the weight."""

import numpy as np
import pytest

import wbc
from tests.view.live.conftest import Stage, balanced, frame_at
from wbc.view.live.collect import controller_info
from wbc.view.live.layers.forces import REACH, point_of_action
from wbc.view.live.layers.layer import GREEN, VERMILION
from wbc.view.live.messages import ControllerInfo


@pytest.fixture(scope="module")
def standing(robot: wbc.Robot) -> wbc.TorqueController:
    start = robot.snapshot(robot.posture("standing"))
    tasks = [wbc.ComTask(robot, start.com, weight=10.0), wbc.PostureTask(robot, start.q)]
    contacts = wbc.support(start, "double")
    return wbc.TorqueController(robot, tasks, contacts=contacts, torque_limits=None)


def test_arrows_carry_the_weight_from_inside_the_soles(stage, standing) -> None:
    robot, snapshot = standing.robot, stage.show(standing)
    arrows = stage.handle("/contact_forces/arrows")
    assert arrows.visible
    ways = arrows.points[:, 1] - arrows.points[:, 0]
    # Single precision; at rest the forces carry the weight, to what the tasks pull by.
    total = ways.sum(axis=0) / (REACH * stage.page._margins.size)
    np.testing.assert_allclose(total, [0.0, 0.0, 1.0], atol=1e-2)
    for foot, start in zip(robot.feet.values(), arrows.points[:, 0], strict=True):
        local = snapshot.rotation(foot.frame).T @ (start - snapshot.position(foot.frame))
        assert abs(local[2]) < 1e-5
        low, high = foot.polygon.min(axis=0) - 1e-5, foot.polygon.max(axis=0) + 1e-5
        assert (low <= local[:2]).all()
        assert (local[:2] <= high).all()
        cone = stage.handle(f"/contact_forces/cone {foot.frame}")
        assert cone.visible
        np.testing.assert_allclose(cone.position, start, atol=1e-6)


def test_the_cop_drawn_is_that_of_the_tick(stage: Stage, standing: wbc.TorqueController) -> None:
    tick = standing.step(stage.show(standing))
    assert tick.cop is not None
    np.testing.assert_allclose(stage.handle("/leg_cop_cmp/cop").position, tick.cop, atol=1e-6)
    assert stage.handle("/leg_cop_cmp/cmp").visible


def test_a_force_at_the_edge_of_its_cone_is_red(stage, standing) -> None:
    robot = standing.robot
    cast: ControllerInfo = controller_info(standing)
    frame = frame_at(standing, robot.posture("standing"), 0.0)
    left, right = (foot.frame for foot in robot.feet.values())
    mu = 0.6 * np.cos(np.pi / 4.0)  # of the pyramid inside the cone
    told = frame.told
    assert told is not None
    forces = {left: np.array([mu * 30.0, 0, 30.0, 0, 0, 0]), right: np.array([1.0, 0, 30, 0, 0, 0])}
    object.__setattr__(told, "forces", forces)
    stage.draw(cast, frame)
    colours = stage.handle("/contact_forces/arrows").colors
    np.testing.assert_array_equal(colours, [VERMILION, GREEN])


def test_the_kinematic_level_has_no_forces(stage: Stage, robot: wbc.Robot) -> None:
    stage.show(balanced(robot))
    assert not stage.handle("/contact_forces/arrows").visible


@pytest.mark.parametrize("seed", range(3))
def test_a_wrench_has_no_tilting_moment_about_where_it_acts(seed: int) -> None:
    rng = np.random.default_rng(seed)
    place, wrench = rng.normal(size=3), rng.normal(size=6)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    wrench[:3] = rotation @ [*rng.normal(size=2), 5.0]
    point = point_of_action(place, wrench, rotation)
    moment = rotation.T @ (wrench[3:] + np.cross(place - point, wrench[:3]))
    np.testing.assert_allclose(moment[:2], 0.0, atol=1e-12)
    assert abs(rotation[:, 2] @ (point - place)) < 1e-12
