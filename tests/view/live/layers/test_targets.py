"""Ghosts stand where the tasks want the robot, and dragging them asks for that."""

import numpy as np
import pytest

import wbc
from tests.view.live.conftest import Stage, client_of, drag, frame_at, rotation_of
from wbc.rmp.ellipsoid import equimomental
from wbc.rotations import exp_rotation
from wbc.view.live.messages import SetTarget

TURN = exp_rotation(np.array([0.3, -0.2, 0.1]))


@pytest.fixture(scope="module")
def hands(robot: wbc.Robot) -> tuple[str, str]:
    links = [name for name in robot.frame_names if "hand" in name or "wrist" in name]
    return links[0], links[-1]


@pytest.fixture
def controller(robot: wbc.Robot, hands: tuple[str, str]) -> wbc.KinematicController:
    start = robot.snapshot(robot.posture("standing"))
    (left, right), moments = hands, 1.3 * np.diag(start.inertia)
    tasks = [
        wbc.ComTask(robot, start.com + [0.01, 0.02, 0.5], axes=["x", "y"]),
        wbc.PositionTask(robot, left, start.position(left) + 0.1, name="place"),
        wbc.OrientationTask(robot, left, TURN, name="turn"),
        wbc.PoseTask(robot, right, start.position(right) - 0.1, TURN, name="pose"),
        wbc.InertiaTask(robot, moments, components=["xx", "yy", "zz"], name="shape"),
        wbc.AxisTask(robot, "base", [0.0, 0.0, 1.0], name="up"),
    ]
    return wbc.KinematicController(robot, tasks)


def test_ghosts_are_at_the_targets(stage, controller, hands) -> None:
    robot, start = controller.robot, stage.show(controller)
    left, right = (stage.handle(f"/targets/{hand}") for hand in hands)
    np.testing.assert_allclose(left.position, start.position(hands[0]) + 0.1, atol=1e-9)
    np.testing.assert_allclose(right.position, start.position(hands[1]) - 0.1, atol=1e-9)
    for ghost in (left, right):
        np.testing.assert_allclose(rotation_of(ghost), TURN, atol=1e-9)
    # Height is not wanted: it is where it is.
    com = stage.handle("/targets/com").position
    np.testing.assert_allclose(com, start.com + [0.01, 0.02, 0.0], atol=1e-9)
    wanted = start.inertia + np.diag(0.3 * np.diag(start.inertia))
    ghost = stage.handle("/targets/ellipsoid shape")
    np.testing.assert_allclose(ghost.scale, equimomental(wanted, robot.mass).semi_axes, rtol=1e-9)
    arrow = stage.handle("/targets/axes").points[0]
    np.testing.assert_allclose(np.cross(arrow[1] - arrow[0], [0.0, 0.0, 1.0]), 0.0, atol=1e-6)


def test_an_inertia_that_no_body_has_is_not_drawn(stage: Stage, robot: wbc.Robot) -> None:
    task = wbc.InertiaTask(robot, np.diag([1.0, 1.0, 9.0]))
    stage.show(wbc.KinematicController(robot, [task]))
    assert not stage.handle("/targets/ellipsoid inertia").visible


def test_dragging_asks_for_targets(stage, controller, hands, monkeypatch) -> None:
    monkeypatch.setattr("wbc.view.live.layers.targets.HELD", 1e3)  # a busy machine takes seconds
    q = stage.show(controller).q
    # The view follows a robot far away, and handles are told in the world's axes all the same.
    far = q + 3.0 * np.eye(q.size)[0]
    stage.draw(frame_at(controller, far, 0.01))
    assert stage.handle("").position[0] < -0.01
    with client_of(stage.url) as client:
        drag(client, hands[0], [0.1, 0.2, 0.3])
        asked = [stage.pipe.recv() for _ in range(2)]
        for name, *place in ((hands[1], [0.4, 0.5, 0.6], (0, 1, 0, 0)), ("com", [0, 0, 0.7])):
            drag(client, name, *place)
            asked.append(stage.pipe.recv())
    assert all(isinstance(one, SetTarget) for one in asked)
    place, turn, pose, com = (one.target for one in asked)
    assert [one.task for one in asked] == ["place", "turn", "pose", "com"]
    np.testing.assert_allclose(place[0], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(turn[0], np.eye(3))
    np.testing.assert_allclose(pose[0], [0.4, 0.5, 0.6])
    np.testing.assert_allclose(pose[1], np.diag([1.0, -1.0, -1.0]), atol=1e-12)
    np.testing.assert_allclose(com[0], [0.0, 0.0, 0.7])
    # A handle in somebody's hand is not taken away by the next frame.
    stage.draw(frame_at(controller, q, 0.1))
    np.testing.assert_allclose(stage.handle(f"/drag_targets/{hands[0]}").position, [0.1, 0.2, 0.3])
