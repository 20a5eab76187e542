"""Minimum-jerk ramps, and the spaces of targets, against the rules that they must keep."""

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from wbc.minimum_jerk import PEAK, minimum_jerk_rates
from wbc.robot import Robot
from wbc.run.ramps import (
    DIRECTIONS,
    PLACEMENTS,
    ROTATIONS,
    VECTORS,
    MinimumJerk,
    configuration_space,
    placement,
)

RAMP = MinimumJerk(np.array([1.0, -2.0, 0.5]), np.array([3.0, 5.0, 0.5]), 1.7)


@pytest.mark.parametrize("t", np.linspace(0.05, 1.65, 9))
def test_rate_and_acceleration_are_derivatives(t: float) -> None:
    h = 1e-4
    _, rate, acceleration = RAMP.at(t)
    ahead, behind = RAMP.at(t + h), RAMP.at(t - h)
    # Central differences: h^2/6 times a third derivative of at most 60 * 7 / 1.7^3 is below 2e-6.
    np.testing.assert_allclose(rate, (ahead[0] - behind[0]) / (2 * h), atol=2e-6)
    # The same with a fifth derivative of at most 720 * 7 / 1.7^5 * 10 in all.
    np.testing.assert_allclose(acceleration, (ahead[1] - behind[1]) / (2 * h), atol=2e-5)


def test_it_solves_the_minimum_jerk_problem() -> None:
    # Optimal iff the sixth derivative vanishes (a quintic) and the six end conditions hold.
    times = np.linspace(0.0, RAMP.duration, 50)
    values = np.array([RAMP.at(t)[0][1] for t in times])
    quintic = np.polynomial.Polynomial.fit(times, values, 5)
    np.testing.assert_allclose(quintic(times), values, atol=1e-12)
    for t, place in ((0.0, RAMP.start[1]), (RAMP.duration, RAMP.end[1])):
        np.testing.assert_allclose(quintic(t), place, atol=1e-12)
        np.testing.assert_allclose(quintic.deriv()(t), 0.0, atol=1e-10)
        np.testing.assert_allclose(quintic.deriv(2)(t), 0.0, atol=1e-9)


def test_it_rests_before_and_after_and_ends_exactly() -> None:
    for t, place in ((-1.0, RAMP.start), (0.0, RAMP.start), (1.7, RAMP.end), (99.0, RAMP.end)):
        value, rate, acceleration = RAMP.at(t)
        np.testing.assert_allclose(value, place, rtol=0, atol=1e-15)
        assert not rate.any()
        assert not acceleration.any()
    assert (RAMP.at(1.7)[0] == RAMP.end).all()


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
    "configurations": (configuration_space(ROBOT), configuration),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("seed", range(5))
def test_the_displacement_leads_there_and_its_parts_add_up(name: str, seed: int) -> None:
    space, draw = CASES[name]
    rng = np.random.default_rng(seed)
    start, end = draw(rng), draw(rng)
    displacement = space.difference(start, end)
    np.testing.assert_allclose(space.integrate(start, displacement), end, atol=1e-12)
    np.testing.assert_allclose(space.integrate(start, 0.0 * displacement), start, atol=1e-12)
    half = space.integrate(space.integrate(start, 0.3 * displacement), 0.2 * displacement)
    np.testing.assert_allclose(half, space.integrate(start, 0.5 * displacement), atol=1e-12)
    np.testing.assert_allclose(space.integrate(end, -0.5 * displacement), half, atol=1e-12)


def test_rotations_turn_the_shortest_way() -> None:
    rng = np.random.default_rng(0)
    start, end = rotation(rng), rotation(rng)
    expected = (Rotation.from_matrix(start).inv() * Rotation.from_matrix(end)).as_rotvec()
    np.testing.assert_allclose(ROTATIONS.difference(start, end), expected, atol=1e-12)


@pytest.mark.parametrize("end", [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [1e-12, 0.0, -1.0]])
def test_the_same_and_the_opposite_direction_are_reached(end: list[float]) -> None:
    start = np.array([0.0, 0.0, 1.0])
    displacement = DIRECTIONS.difference(start, np.array(end))
    assert np.isfinite(displacement).all()
    np.testing.assert_allclose(DIRECTIONS.integrate(start, displacement), end, atol=1e-9)
    assert np.linalg.norm(DIRECTIONS.integrate(start, 0.5 * displacement)) == pytest.approx(1.0)


@pytest.mark.parametrize("name", CASES)
def test_ramps_start_and_end_where_they_should_and_move_at_their_rate(name: str) -> None:
    space, draw = CASES[name]
    rng = np.random.default_rng(7)
    ramp = MinimumJerk(draw(rng), draw(rng), 1.3, space)
    np.testing.assert_allclose(ramp.at(0.0)[0], ramp.start, atol=1e-12)
    np.testing.assert_array_equal(
        ramp.at(1.3)[0], space.integrate(ramp.end, 0.0 * ramp.displacement)
    )
    h = 1e-5
    for t in (0.2, 0.65, 1.1):
        rate = ramp.at(t)[1]
        part = space.difference(ramp.at(t - h)[0], ramp.at(t + h)[0]) / (2.0 * h)
        np.testing.assert_allclose(part, rate, atol=1e-6)  # h^2 times a third derivative


def test_a_placement_moves_as_pinocchio_says() -> None:
    rng = np.random.default_rng(3)
    start, end = (placement(rng.standard_normal(3), rotation(rng)) for _ in range(2))
    middle = PLACEMENTS.integrate(start, 0.5 * PLACEMENTS.difference(start, end))
    expected = start[:, :3] @ pin.exp3(0.5 * pin.log3(start[:, :3].T @ end[:, :3]))
    np.testing.assert_allclose(middle[:, :3], expected, atol=1e-12)
    np.testing.assert_allclose(middle[:, 3], 0.5 * (start + end)[:, 3], atol=1e-12)


def test_the_peak_is_the_largest_slope() -> None:
    slopes = [minimum_jerk_rates(x)[0] for x in np.linspace(0.0, 1.0, 101)]
    assert max(slopes) == pytest.approx(PEAK, rel=1e-12)
