"""The two laws applied to a task: the error decays as promised when the rows are met exactly."""

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.laws import AccelerationLaw, Residual, VelocityLaw
from wbc.tasks import ComTask, DampingTask, MomentumTask


def test_velocity_law_removes_the_gain_in_one_tick(robot, rng, random_snapshot) -> None:
    here = random_snapshot(robot, rng)
    task = ComTask(robot, here.com + [0.01, -0.02, 0.03], gain=0.25)
    dt = 1e-4
    rows = task.law.rows(task.residual(here), task.weight, dt)
    v = np.linalg.pinv(rows.matrix) @ rows.target
    there = robot.snapshot(robot.integrate(here.q, v, dt))
    before, after = task.residual(here).error, task.residual(there).error
    np.testing.assert_allclose(after, 0.75 * before, atol=2e-3 * np.abs(before).max())


def test_velocity_law_follows_a_moving_target(robot, rng, random_snapshot) -> None:
    here = random_snapshot(robot, rng)
    task = ComTask(robot, here.com)
    rate = np.array([0.1, 0.2, -0.3])
    task.set_target(here.com, rate)
    rows = VelocityLaw(0.5).rows(task.residual(here), task.weight, 0.005)
    np.testing.assert_allclose(rows.target, rate)


@pytest.mark.parametrize("kd", [None, 5.0])
def test_momentum_decays_by_kd_to_a_target_that_moves(robot_named, rng, kd: float | None) -> None:
    """Oracle: h - h* = (h - h*)(0) exp(-kd t), with h*' = force, whatever the joints do."""
    robot = robot_named("hoap2_like")
    q, v = robot.posture("standing"), 0.3 * rng.normal(size=robot.nv)
    force, dt, steps = np.array([2.0, -1.0, 3.0, 0.1, 0.2, -0.3]), 5e-5, 1000
    task = MomentumTask(robot, np.zeros(6), kd=kd)
    start = robot.snapshot(q, v).momentum
    for k in range(steps):
        task.set_target(k * dt * force, force)
        here = robot.snapshot(q, v)
        residual = task.residual(here)
        rows = task.acceleration_law.rows(residual, task.drift(here), v, task.weight, dt)
        v = v + np.linalg.pinv(rows.matrix) @ (rows.target - rows.matrix @ v)
        q = robot.integrate(q, v, dt)
    task.set_target(steps * dt * force, force)
    here = robot.snapshot(q, v)
    expected = start * np.exp(-(20.0 if kd is None else kd) * steps * dt)
    # Euler steps: kd dt / 2 of the whole decay in proportion, 5e-4 for 20/s, and the drift's own.
    found = task.deviation(here, task.residual(here))
    np.testing.assert_allclose(found, expected, rtol=0, atol=3e-3 * np.abs(start).max())


def test_capture_point_law_moves_the_capture_point_exponentially() -> None:
    """Oracle: c'' = w^2 (c - xi - k e_xi) integrated in closed form by its two real modes."""
    height, gain, gravity = 0.7, 2.5, 9.81
    law = AccelerationLaw.capture_point(height, gain, gravity)
    omega = np.sqrt(gravity / height)
    assert law.kd is not None
    modes = np.roots([1.0, law.kd, law.kp])
    np.testing.assert_allclose(np.sort(modes), [-gain * omega, -omega], rtol=1e-12)
    for error, rate in np.random.default_rng(3).normal(size=(5, 2)):
        wanted = -law.kp * error - law.kd * rate
        point = error + rate / omega  # of the capture point, from the target
        pivot = point + gain * point
        np.testing.assert_allclose(wanted, omega**2 * (error - pivot), rtol=1e-12)
    with pytest.raises(InvalidInputError, match="capture point, height"):
        AccelerationLaw.capture_point(0.0)


def test_what_acts_on_errors_is_refused_by_tasks_without(robot_named) -> None:
    robot = robot_named("hoap2_like")
    for key in ("gain", "gain_per_second", "lm_damping", "curvature_damping", "kp"):
        for kind in (MomentumTask, DampingTask):
            with pytest.raises(InvalidInputError, match=f"{key}: has no effect.*give kd"):
                kind(robot, **{key: 1.0})
    task = MomentumTask(robot, kd=3.0)
    with pytest.raises(InvalidInputError, match="gain: has no effect"):
        task.gain = 0.3
    assert task.acceleration_law == AccelerationLaw(kd=3.0)


def test_lm_damping_is_proportional_to_the_weighted_error() -> None:
    residual = Residual(np.array([3.0, 4.0]), np.eye(2), np.zeros(2))
    rows = VelocityLaw(1.0, lm_damping=0.1).rows(residual, np.array([2.0, 2.0]), 1.0)
    assert rows.damping == pytest.approx(1.0)
    assert VelocityLaw(1.0).rows(residual, np.ones(2), 1.0).damping == 0.0


def test_acceleration_law_makes_a_damped_oscillator() -> None:
    """Oracle: the closed form of e'' = -kp e - kd e' with kd = 2 sqrt(kp)."""
    kp, dt = 100.0, 1e-5
    e, v, drift = np.array([1.0]), np.array([0.5]), np.array([0.7])
    t_end = 0.1
    for _ in range(round(t_end / dt)):
        rows = AccelerationLaw(kp).rows(
            Residual(e, np.eye(1), np.zeros(1)), drift, v, np.ones(1), dt
        )
        v = rows.target + dt * drift  # the plant adds the drift that the law has taken off
        e = e + dt * v
    w = np.sqrt(kp)
    expected = (1.0 + (0.5 + w * 1.0) * t_end) * np.exp(-w * t_end)
    # Semi-implicit Euler of step 1e-5 over 0.1 s: error of order w^2 dt t = 1e-4.
    assert e[0] == pytest.approx(expected, abs=2e-4)


def test_acceleration_law_damps_the_rate_of_the_error_not_of_the_point() -> None:
    """A target that moves along: at its place and at its rate nothing is asked for."""
    moving = Residual(np.zeros(1), np.eye(1), np.array([-0.3]))
    rows = AccelerationLaw(100.0).rows(moving, np.zeros(1), np.array([0.3]), np.ones(1), 0.002)
    np.testing.assert_allclose(rows.target, 0.3)


@pytest.mark.parametrize("dt", [1e-3, 5e-3, 2e-2])
def test_a_gain_per_second_means_the_same_at_every_step(dt: float) -> None:
    """Oracle: exp(-k t), met exactly at the end of every tick."""
    e, law = np.array([1.0]), VelocityLaw(gain_per_second=8.0)
    for _ in range(round(0.2 / dt)):
        e = e + dt * law.rows(Residual(e, np.eye(1), np.zeros(1)), np.ones(1), dt).target
    assert e[0] == pytest.approx(np.exp(-8.0 * 0.2), rel=1e-12)


def test_the_plain_step_of_eq_38_has_no_curvature_damping() -> None:
    residual = Residual(np.ones(2), np.eye(2), np.zeros(2), curvature_bound=3.0)
    assert VelocityLaw(1.0).rows(residual, np.ones(2), 0.01).damping == pytest.approx(1.5)
    plain = VelocityLaw(1.0, curvature_damping=False).rows(residual, np.ones(2), 0.01)
    assert plain.damping == 0.0
    np.testing.assert_allclose(0.01 * plain.target, -residual.error)


def test_laws_are_checked_where_they_are_given(robot) -> None:
    for bad in ({"gain": 0.0}, {"gain": 1.5}, {"gain_per_second": 0.0}, {"kp": -1.0}):
        (name,) = bad
        with pytest.raises(InvalidInputError, match=f"task 'com', {name}"):
            ComTask(robot, np.zeros(3), **bad)
    with pytest.raises(InvalidInputError, match="gain or gain_per_second, not both"):
        ComTask(robot, np.zeros(3), gain=0.5, gain_per_second=3.0)
    task = ComTask(robot, np.zeros(3), gain_per_second=3.0, kp=50.0)
    task.gain = 0.25
    assert task.law == VelocityLaw(0.25)
    assert task.acceleration_law == AccelerationLaw(50.0)
