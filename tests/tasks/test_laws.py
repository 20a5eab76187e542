"""The two laws applied to a task: the error decays as promised when the rows are met exactly."""

import numpy as np
import pytest

from wbc.constraints import Contact
from wbc.controllers import KinematicController
from wbc.errors import InvalidInputError
from wbc.laws import AccelerationLaw, Residual, VelocityLaw
from wbc.tasks import ComTask, DampingTask, MomentumTask, PoseTask, PostureTask, Task


def test_velocity_law_removes_the_gain_in_one_tick(robot, rng, random_snapshot) -> None:
    here = random_snapshot(robot, rng)
    task = ComTask(robot, here.com + [0.01, -0.02, 0.03], gain=0.25)
    dt = 1e-4
    v = KinematicController(robot, [task], contacts=(), dt=dt).step(here).velocity
    there = robot.snapshot(robot.integrate(here.q, v, dt))
    before, after = task.residual(here).error, task.residual(there).error
    np.testing.assert_allclose(after, 0.75 * before, atol=2e-3 * np.abs(before).max())


def test_velocity_law_follows_a_moving_target(robot, rng, random_snapshot) -> None:
    here = random_snapshot(robot, rng)
    task = ComTask(robot, here.com)
    rate = np.array([0.1, 0.2, -0.3])
    task.set_target(here.com, rate)
    v = KinematicController(robot, [task], contacts=()).step(here).velocity
    np.testing.assert_allclose(here.com_jacobian @ v, rate, rtol=1e-4)  # the damping is 1e-6


@pytest.mark.parametrize("kd", [None, 5.0])
def test_momentum_decays_by_kd_to_a_target_that_moves(hoap2, rng, kd: float | None) -> None:
    """Oracle: h - h* = (h - h*)(0) exp(-kd t), with h*' = force, whatever the joints do."""
    q, v = hoap2.posture("standing"), 0.3 * rng.normal(size=hoap2.nv)
    force, dt, steps = np.array([2.0, -1.0, 3.0, 0.1, 0.2, -0.3]), 5e-5, 1000
    task = MomentumTask(hoap2, np.zeros(6), kd=kd)
    start = hoap2.snapshot(q, v).momentum
    for k in range(steps):
        task.set_target(k * dt * force, force)
        here = hoap2.snapshot(q, v)
        residual = task.residual(here)
        slowing = -task.acceleration_law.velocity_gain * residual.rate(v) - task.drift(here)
        v = v + np.linalg.pinv(residual.jacobian) @ (dt * slowing)
        q = hoap2.integrate(q, v, dt)
    task.set_target(steps * dt * force, force)
    here = hoap2.snapshot(q, v)
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


def test_what_acts_on_errors_is_refused_by_tasks_without(hoap2) -> None:
    for key in ("gain", "gain_per_second", "lm_damping", "curvature_damping", "weighs_error", "kp"):
        for kind in (MomentumTask, DampingTask):
            with pytest.raises(InvalidInputError, match=f"{key}: has no effect.*give kd"):
                kind(hoap2, **{key: 1.0})
    task = MomentumTask(hoap2, kd=3.0)
    with pytest.raises(InvalidInputError, match="gain: has no effect"):
        task.gain = 0.3
    assert task.acceleration_law == AccelerationLaw(kd=3.0)


class Fixed(Task):
    """Two joints, with an error and a curvature that are given."""

    def residual(self, snapshot):
        J = np.eye(2, self.robot.nv, 6)
        return Residual(np.array([3.0, 4.0]), J, np.zeros(2), curvature_bound=3.0)


@pytest.mark.parametrize(
    ("law", "added"),
    [
        ({"gain": 1.0}, 1.5),
        ({"gain": 0.5}, 0.75),
        ({"gain": 1.0, "curvature_damping": False}, 0.0),  # the plain step of eq. 38
        ({"gain": 1.0, "curvature_damping": False, "lm_damping": 0.1}, 1.0),
    ],
)
def test_damping_is_that_of_curvature_and_weighted_error(robot, law, added: float) -> None:
    """0.5 gain times the curvature's bound 3; lm_damping times |2 (3, 4)|."""
    task = Fixed(robot, "fixed", ("a", "b"), weight=2.0, **law)
    controller = KinematicController(robot, [task], contacts=(), damping=1e-6)
    diagonal = controller.step(robot.snapshot(robot.posture("standing"))).qp.P[8, 8]
    assert diagonal == pytest.approx(added + 1e-6, abs=1e-12)


def test_a_pose_is_damped_by_the_error_of_all_its_rows(robot) -> None:
    """It is two blocks to the core: place, and turn."""
    here = robot.snapshot(robot.posture("standing"))
    turned = np.diag([1.0, -1.0, -1.0]) @ here.rotation("base")
    task = PoseTask(robot, "base", here.position("base") + [0.1, 0.0, 0.0], turned, lm_damping=0.1)
    qp = KinematicController(robot, [task], contacts=(), damping=1e-6).step(here).qp
    added = 0.1 * np.linalg.norm(task.residual(here).error)
    np.testing.assert_allclose(np.diag(qp.P)[6:], added + 1e-6, rtol=1e-9)


@pytest.mark.parametrize("dt", [1e-3, 5e-3, 2e-2])
def test_a_gain_per_second_means_the_same_at_every_step(robot, dt: float) -> None:
    """Oracle: exp(-k t), met exactly at the end of every tick."""
    q = robot.posture("standing")
    task = PostureTask(robot, q, gain_per_second=8.0)
    controller = KinematicController(robot, [task], contacts=(), dt=dt, damping=1e-9)
    q = robot.integrate(q, np.r_[np.zeros(6), np.full(robot.nv - 6, 1e-2)], 1.0)
    before = task.residual(robot.snapshot(q)).error
    for _ in range(round(0.2 / dt)):
        q = robot.integrate(q, controller.step(robot.snapshot(q)).velocity, dt)
    after = task.residual(robot.snapshot(q)).error
    np.testing.assert_allclose(after, np.exp(-8.0 * 0.2) * before, rtol=1e-6)


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
    here = robot.snapshot(robot.posture())
    assert Contact.hold(here, "base").acceleration_law == AccelerationLaw(100.0)
