"""Mimic joints on a fixed base: the gear holds, and the motion is that of the constrained tree."""

import numpy as np
import pytest

from tests.urdf import geared_arm, limit
from wbc.robot import Robot
from wbc.simulation import Plant


@pytest.fixture
def arm() -> Robot:
    """Joints a, b and c, of which c follows b at -2 b + 0.1; the base is bolted."""
    return Robot.load(geared_arm("abc", at="0.02 0 0.1", limits=limit(2, 99, 9)))


def test_the_geared_tree_moves_as_lagrange_says(arm: Robot) -> None:
    """With v = G u the motion is G' (M G du/dt + h) = G' tau, at the first step."""
    assert arm.fixed_base and list(arm.couplings) == ["c"]
    plant = Plant(arm, dt=1e-3, shapes=False)
    G = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, -2.0]])
    q = arm.posture("neutral", {"a": 0.3, "b": 0.4})
    u, torque = np.array([0.5, -0.3]), np.array([3.0, 1.0, -2.0])
    v = np.concatenate((np.zeros(6), G @ u))
    s = arm.snapshot(q, v)
    M, h = s.mass_matrix[6:, 6:], s.bias[6:]
    rate = np.linalg.solve(G.T @ M @ G, G.T @ (torque - h))
    plant.reset(q, v)
    plant.step(torque)
    found = (plant.state()[1][6:] - v[6:]) / 1e-3
    np.testing.assert_allclose(found, G @ rate, rtol=1e-3)  # 1e-4 of it is the gear's softness


def test_the_gear_holds_under_load(arm: Robot) -> None:
    plant = Plant(arm, shapes=False)
    plant.reset(arm.posture("neutral", {"a": 0.3, "b": 0.2}))
    worst = 0.0
    for k in range(500):
        q, v = plant.state()
        a, b, c = arm.limits.joint_positions(q)
        worst = max(worst, abs(c - (-2.0 * b + 0.1)))
        swing = 8.0 * np.sin(0.02 * k)
        plant.step(np.array([-30.0 * a, swing, 0.0]) - 2.0 * v[6:])
        assert abs(b) < 1.0
    assert worst < 1e-4  # rad
