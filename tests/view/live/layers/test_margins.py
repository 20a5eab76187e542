"""Nearest pairs and obstacles as drawn, against the constraints that keep them apart."""

import numpy as np
import pytest

import wbc
from tests.view.live.conftest import frame_at
from wbc.constraints.margin import SKIN
from wbc.rotations import exp_rotation
from wbc.view.live.layers.layer import surface_of


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
