"""Distances of segments against a bounded minimisation by SciPy, and against finite differences."""

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from wbc.controllers.shaping import CapsulePair
from wbc.controllers.shaping.capsules import segment_distance, squared_segment_distance
from wbc.errors import InvalidInputError
from wbc.robot.symbolic import (
    LocalRobot,
    Placement,
    SymbolicPosture,
    configuration_turns,
    from_quaternion,
)

ENDS = ca.SX.sym("ends", 12)
SQUARED = squared_segment_distance(ENDS[:3], ENDS[3:6], ENDS[6:9], ENDS[9:])
VALUE = ca.Function("value", [ENDS], [SQUARED])
GRADIENT = ca.Function("gradient", [ENDS], [ca.gradient(SQUARED, ENDS)])


def by_scipy(ends: np.ndarray) -> float:
    """min |a0 + s u - b0 - t v| over 0 <= s, t <= 1, as bounded linear least squares."""
    a0, a1, b0, b1 = ends.reshape(4, 3)
    matrix = np.column_stack((a1 - a0, b0 - b1))
    found = lsq_linear(matrix, b0 - a0, bounds=(0, 1), method="bvls", tol=1e-14)
    return float(np.sqrt(2 * found.cost))


def cases(rng: np.random.Generator) -> list[np.ndarray]:
    generic = [rng.normal(size=12) for _ in range(100)]
    parallel = []
    for _ in range(20):
        ends = rng.normal(size=12)
        ends[9:] = ends[6:9] + rng.normal() * (ends[3:6] - ends[:3])
        parallel.append(ends)
    points = [ends.copy() for ends in generic[:20]]
    for k, ends in enumerate(points):
        if k % 2 == 0:
            ends[3:6] = ends[:3]
        if k % 3 == 0:
            ends[9:] = ends[6:9]
    return generic + parallel + points


def test_distances_are_the_least_over_both_segments(rng) -> None:
    for ends in cases(rng):
        expected = by_scipy(ends)
        np.testing.assert_allclose(segment_distance(*ends.reshape(4, 3)), expected, atol=1e-7)
        # The 1e-12 m^2 that keeps divisions from failing shows where segments are nearly parallel.
        np.testing.assert_allclose(float(VALUE(ends)) ** 0.5, expected, atol=1e-5)


def test_squared_distance_is_once_differentiable(rng) -> None:
    h = 1e-6
    for ends in cases(rng)[:100]:
        expected = [
            (by_scipy(ends + step) ** 2 - by_scipy(ends - step) ** 2) / (2 * h)
            for step in h * np.eye(12)
        ]
        # Differences of values good to 1e-9 or so over 2e-6.
        np.testing.assert_allclose(np.array(GRADIENT(ends)).ravel(), expected, atol=3e-3)


def test_excess_on_a_robot(robot_named, rng, random_snapshot) -> None:
    robot = robot_named("hoap2_like")
    pair = CapsulePair(
        "left_sole", [0, 0, 0], [0, 0, 0.1], 0.03, "world", [0, 0, 0], [0, 0, 2], 0.02, 0.01
    )
    q = ca.SX.sym("q", robot.nq)
    local = LocalRobot(robot, configuration_turns(robot, q))
    posture = SymbolicPosture(local, Placement(from_quaternion(q[3:7]), q[:3]))
    function = ca.Function("excess", [q], [pair.symbolic_excess(posture)])
    for _ in range(5):
        here = random_snapshot(robot, rng)
        R, p = here.rotation("left_sole"), here.position("left_sole")
        ends = np.concatenate((p, p + 0.1 * R[:, 2], [0, 0, 0], [0, 0, 2]))
        distance = by_scipy(ends)
        assert pair.excess(here) == pytest.approx(distance - 0.06, abs=1e-7)
        assert float(function(here.q)) == pytest.approx(distance**2 - 0.06**2, abs=1e-5)


def test_unusable_capsules_are_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"'a - b', radius_a: must be at least 0"):
        CapsulePair("a", [0, 0, 0], [0, 0, 1], -0.1, "b", [0, 0, 0], [0, 0, 1], 0.1)
    with pytest.raises(InvalidInputError, match=r"'a - b', end_b: expected shape"):
        CapsulePair("a", [0, 0, 0], [0, 0, 1], 0.1, "b", [0, 0, 0], [0, 1], 0.1)
