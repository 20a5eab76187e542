"""The two laws applied to a task: the error decays as promised when the rows are met exactly."""

import numpy as np
import pytest

from wbc.laws import acceleration_law, velocity_law
from wbc.tasks import ComTask
from wbc.tasks.task import Residual


def test_velocity_law_removes_the_gain_in_one_tick(robot, rng, random_snapshot) -> None:
    here = random_snapshot(robot, rng)
    task = ComTask(robot, here.com + [0.01, -0.02, 0.03], gain=0.25)
    dt = 1e-4
    rows = velocity_law(task.residual(here), task.gain, dt, task.weight)
    v = np.linalg.pinv(rows.matrix) @ rows.target
    there = robot.snapshot(robot.integrate(here.q, v, dt))
    before, after = task.residual(here).error, task.residual(there).error
    np.testing.assert_allclose(after, 0.75 * before, atol=2e-3 * np.abs(before).max())


def test_velocity_law_follows_a_moving_target(robot, rng, random_snapshot) -> None:
    here = random_snapshot(robot, rng)
    task = ComTask(robot, here.com)
    rate = np.array([0.1, 0.2, -0.3])
    task.set_target(here.com, rate)
    rows = velocity_law(task.residual(here), 0.5, 0.005, task.weight)
    np.testing.assert_allclose(rows.target, rate)


def test_lm_damping_is_proportional_to_the_weighted_error() -> None:
    residual = Residual(np.array([3.0, 4.0]), np.eye(2), np.zeros(2))
    rows = velocity_law(residual, 1.0, 1.0, np.array([2.0, 2.0]), lm_damping=0.1)
    assert rows.damping == pytest.approx(1.0)
    assert velocity_law(residual, 1.0, 1.0, np.ones(2)).damping == 0.0


def test_acceleration_law_makes_a_damped_oscillator() -> None:
    """Oracle: the closed form of e'' = -kp e - kd e' with kd = 2 sqrt(kp)."""
    kp, dt = 100.0, 1e-5
    kd = 2 * np.sqrt(kp)
    e, v, drift = np.array([1.0]), np.array([0.5]), np.array([0.7])
    t_end = 0.1
    for _ in range(round(t_end / dt)):
        rows = acceleration_law(Residual(e, np.eye(1), np.zeros(1)), drift, v, kp, kd, np.ones(1))
        a = rows.target + drift  # the plant adds the drift that the law has taken off
        v = v + dt * a
        e = e + dt * v
    w = np.sqrt(kp)
    expected = (1.0 + (0.5 + w * 1.0) * t_end) * np.exp(-w * t_end)
    # Semi-implicit Euler of step 1e-5 over 0.1 s: error of order w^2 dt t = 1e-4.
    assert e[0] == pytest.approx(expected, abs=2e-4)
