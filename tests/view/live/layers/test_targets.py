"""Ghosts, handles, nearest pairs and obstacles as drawn, against tasks and constraints."""

import numpy as np
import pytest

import wbc
from tests.view.live.conftest import Stage, client_of, drag, frame_at, rotation_of
from wbc.constraints.margin import SKIN
from wbc.rmp.ellipsoid import equimomental
from wbc.rotations import exp_rotation
from wbc.view.live.layers.layer import surface_of
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


@pytest.fixture
def ball() -> wbc.Obstacle:
    return wbc.Obstacle.sphere("ball", [0.0, 0.0, 0.0], 0.05)


@pytest.fixture
def careful(robot: wbc.Robot, ball: wbc.Obstacle) -> wbc.KinematicController:
    start = robot.snapshot(robot.posture("standing"))
    ball.move(exp_rotation(np.array([0.1, 0.2, 0.3])), [0.25, 0.0, 0.3])
    kept = [wbc.SelfCollision(robot, margin=0.005), wbc.Obstacles(robot, [ball], margin=0.02)]
    return wbc.KinematicController(robot, [wbc.ComTask(robot, start.com)], constraints=kept)


def test_distances_and_margins_are_those_of_the_constraints(stage, careful, ball) -> None:
    robot = careful.robot
    rng = np.random.default_rng(1)
    step = np.concatenate([np.zeros(6), 0.1 * rng.normal(size=robot.nv - 6)])
    q = robot.integrate(robot.posture("standing"), step, 1.0)
    snapshot = stage.show(careful, q)
    listed = {pair.label: pair for pair in stage.page._margins.nearest}
    assert len(listed) == 12
    for constraint in careful.constraints:
        assert isinstance(constraint, wbc.SelfCollision | wbc.Obstacles)
        distances = constraint.distances(snapshot)
        nearest = np.argsort(distances.clearance)
        labels = constraint.labels(distances)
        assert {labels[k] for k in nearest[:3]} <= set(listed)
        for k, label in enumerate(labels):
            if label in listed:
                pair = listed[label]
                left = pair.distance - pair.margin - SKIN
                assert left == pytest.approx(distances.clearance[k], abs=1e-7)
    ends = np.array([pair.ends for pair in listed.values()])
    lengths = [pair.distance for pair in listed.values()]
    np.testing.assert_allclose(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), lengths, atol=1e-9)
    of_ball = next(pair for label, pair in listed.items() if label.endswith("vs ball"))
    assert np.linalg.norm(of_ball.ends[1] - ball.origin) == pytest.approx(0.05, abs=1e-6)


def test_an_obstacle_moves_with_its_frame(stage, careful, ball) -> None:
    q = stage.show(careful).q
    node = stage.handle("/obstacles/ball")
    np.testing.assert_allclose(node.position, ball.origin, atol=1e-9)
    ball.move(np.eye(3), [0.5, 0.1, 0.2])
    stage.draw(frame_at(careful, q, 0.1))
    np.testing.assert_allclose(node.position, [0.5, 0.1, 0.2], atol=1e-9)


SHAPES = [
    wbc.Obstacle.sphere("sphere", [0.1, 0.2, 0.3], 0.1),
    wbc.Obstacle.capsule("capsule", [0.0, 0.0, 0.3], [0.2, -0.1, 0.1], 0.05),
    wbc.Obstacle.capsule("downwards", [0.0, 0.0, 0.3], [0.0, 0.0, 0.1], 0.05),
    wbc.Obstacle.box("box", [0.1, 0.2, 0.3], [0.3, 0.0, 0.1]),
]


@pytest.mark.parametrize("obstacle", SHAPES, ids=lambda one: one.name)
def test_surfaces_are_those_of_the_shapes(obstacle: wbc.Obstacle) -> None:
    """Vertices are on the surface, and cover it: the core's corners are within the radius."""
    surface = surface_of(obstacle.shape)
    core, radius = obstacle.shape.core, obstacle.shape.radius
    if radius > 0.0:
        a, b = core
        along = b - a
        share = np.clip((surface.vertices - a) @ along / max(along @ along, 1e-30), 0.0, 1.0)
        away = np.linalg.norm(surface.vertices - a - share[:, None] * along, axis=1)
        np.testing.assert_allclose(away, radius, atol=1e-9)
    for corner in core:
        nearest = np.linalg.norm(surface.vertices - corner, axis=1).min()
        assert nearest == pytest.approx(radius, abs=1e-9)


def test_a_half_space_is_drawn_as_its_surface() -> None:
    surface = surface_of(wbc.Obstacle.half_space("wall", [-1.0, 1.0, 0.0], 0.3).shape)
    normal = np.array([-1.0, 1.0, 0.0]) / np.sqrt(2.0)
    assert np.abs(surface.vertices @ normal - 0.3).max() < 3e-3
