"""Spaces of targets: differences and ways against the rules they must keep, and ramps in them."""

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from wbc.problem.ramps import MinimumJerk
from wbc.problem.spaces import (
    DIRECTIONS,
    PLACEMENTS,
    ROTATIONS,
    VECTORS,
    Configurations,
    placement,
)
from wbc.robot import Robot

ROBOT = Robot.load("hoap2_like")


def rotation(rng: np.random.Generator) -> np.ndarray:
    return Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix()


def direction(rng: np.random.Generator) -> np.ndarray:
    vector = rng.standard_normal(3)
    return vector / np.linalg.norm(vector)


def configuration(rng: np.random.Generator) -> np.ndarray:
    return ROBOT.integrate(ROBOT.postures["standing"], 0.3 * rng.standard_normal(ROBOT.nv), 1.0)


CASES: dict[str, tuple[Any, Any]] = {
    "vectors": (VECTORS, lambda rng: rng.standard_normal(4)),
    "rotations": (ROTATIONS, rotation),
    "placements": (PLACEMENTS, lambda rng: placement(rng.standard_normal(3), rotation(rng))),
    "directions": (DIRECTIONS, direction),
    "configurations": (Configurations(ROBOT), configuration),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("seed", range(5))
def test_the_way_leads_there_and_its_parts_add_up(name: str, seed: int) -> None:
    space, draw = CASES[name]
    rng = np.random.default_rng(seed)
    start, end = draw(rng), draw(rng)
    way = space.difference(start, end)
    np.testing.assert_allclose(space.moved(start, way), end, atol=1e-12)
    np.testing.assert_allclose(space.moved(start, 0.0 * way), start, atol=1e-12)
    half = space.moved(space.moved(start, 0.3 * way), 0.2 * way)
    np.testing.assert_allclose(half, space.moved(start, 0.5 * way), atol=1e-12)
    np.testing.assert_allclose(space.moved(end, -0.5 * way), half, atol=1e-12)


def test_rotations_turn_the_shortest_way() -> None:
    rng = np.random.default_rng(0)
    start, end = rotation(rng), rotation(rng)
    expected = (Rotation.from_matrix(start).inv() * Rotation.from_matrix(end)).as_rotvec()
    np.testing.assert_allclose(ROTATIONS.difference(start, end), expected, atol=1e-12)


@pytest.mark.parametrize("end", [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [1e-12, 0.0, -1.0]])
def test_the_same_and_the_opposite_direction_are_reached(end: list[float]) -> None:
    start = np.array([0.0, 0.0, 1.0])
    way = DIRECTIONS.difference(start, np.array(end))
    assert np.isfinite(way).all()
    np.testing.assert_allclose(DIRECTIONS.moved(start, way), end, atol=1e-9)
    assert np.linalg.norm(DIRECTIONS.moved(start, 0.5 * way)) == pytest.approx(1.0)


@pytest.mark.parametrize("name", CASES)
def test_ramps_start_and_end_where_they_should_and_move_at_their_rate(name: str) -> None:
    space, draw = CASES[name]
    rng = np.random.default_rng(7)
    ramp = MinimumJerk(draw(rng), draw(rng), 1.3, space)
    np.testing.assert_allclose(ramp.at(0.0)[0], ramp.start, atol=1e-12)
    np.testing.assert_array_equal(ramp.at(1.3)[0], space.moved(ramp.end, 0.0 * ramp.way))
    h = 1e-5
    for t in (0.2, 0.65, 1.1):
        rate = ramp.at(t)[1]
        part = space.difference(ramp.at(t - h)[0], ramp.at(t + h)[0]) / (2.0 * h)
        np.testing.assert_allclose(part, rate, atol=1e-6)  # h^2 times a third derivative


def test_a_placement_moves_as_pinocchio_says() -> None:
    rng = np.random.default_rng(3)
    start, end = (placement(rng.standard_normal(3), rotation(rng)) for _ in range(2))
    middle = PLACEMENTS.moved(start, 0.5 * PLACEMENTS.difference(start, end))
    expected = start[:, :3] @ pin.exp3(0.5 * pin.log3(start[:, :3].T @ end[:, :3]))
    np.testing.assert_allclose(middle[:, :3], expected, atol=1e-12)
    np.testing.assert_allclose(middle[:, 3], 0.5 * (start + end)[:, 3], atol=1e-12)
