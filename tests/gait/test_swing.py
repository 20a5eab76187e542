"""The foot in the air: rates are derivatives, changed goals are met, landings are soft."""

import numpy as np
import pytest

from wbc.gait.swing import Lift, Motion, SwingFoot, towards, turned, upright_on, yaw_of

DT = 0.002


def test_an_unchanged_goal_is_met_on_one_curve_of_least_jerk() -> None:
    goal, T = np.array((0.4, -0.1, 0.2)), 0.4
    now = Motion.rest(np.zeros(3))
    for k in range(1, 186):  # until 0.03 s before the end
        now = towards(now, goal, T - (k - 1) * DT, DT)
        x = k * DT / T
        curve = goal * (10 * x**3 - 15 * x**4 + 6 * x**5)  # Flash and Hogan
        np.testing.assert_allclose(now.value, curve, atol=1e-9)


def test_rates_are_derivatives_though_the_goal_moves(rng: np.random.Generator) -> None:
    now, path = Motion.rest(np.zeros(2)), []
    goal = np.array((0.3, 0.1))
    for k in range(180):
        if k % 30 == 0:
            goal = goal + 0.05 * rng.normal(size=2)
        now = towards(now, goal, 0.4 - k * DT, DT)
        path.append(now)
    values = np.array([one.value for one in path])
    rates = np.array([one.rate for one in path])
    # central differences of a smooth curve: its third derivative times dt^2 / 6
    np.testing.assert_allclose(rates[1:-1], (values[2:] - values[:-2]) / (2 * DT), atol=5e-3)


def test_the_goal_is_met_at_rest() -> None:
    now, goal = Motion.rest(np.zeros(2)), np.array((0.3, 0.1))
    for k in range(220):
        goal = goal + (1e-3 if k < 150 else 0.0)
        now = towards(now, goal, 0.4 - k * DT, DT)
    np.testing.assert_allclose(now.value, goal, atol=1e-3)
    np.testing.assert_allclose(now.rate, 0.0, atol=0.05)


def test_lift() -> None:
    lift = Lift(0.02, 0.05, 0.06)
    assert lift.at(0.0, 2.0) == pytest.approx((0.02, 0.0, 0.0))
    assert lift.at(1.0, 2.0) == pytest.approx((0.05, 0.0, 0.0))
    assert lift.at(0.5, 2.0)[0] == pytest.approx(0.035 + 0.06)
    h, rate = 1e-5, 2.5
    for s in (0.1, 0.37, 0.8):
        ahead, here, behind = (lift.at(s + d, rate) for d in (h, 0.0, -h))
        assert here[1] == pytest.approx((ahead[0] - behind[0]) / (2 * h) * rate, rel=1e-6)
        assert here[2] == pytest.approx((ahead[1] - behind[1]) / (2 * h) * rate, rel=1e-6)


def test_a_foot_rises_as_fast_as_it_goes_ahead() -> None:
    """On a step of 0.35 m, lifted by 5.8 cm: a toe 1 cm before an edge is lifted over 9 mm."""
    s = np.linspace(0.0, 0.5, 501)
    ahead = 0.35 * (10 * s**3 - 15 * s**4 + 6 * s**5)  # Flash and Hogan
    heights = np.array([Lift(0.0, 0.0, 0.058).at(x, 1.0)[0] for x in s])
    assert np.interp(0.01, ahead, heights) > 9e-3


def test_a_foot_that_finds_no_ground_goes_on_down() -> None:
    foot = SwingFoot(Motion.rest(np.zeros(3)), 0.0, np.array((0.0, 0.0, 1.0)), 0.05, 0.2)
    left = 0.4
    while left > -0.1:
        foot = foot.advanced(np.array((0.2, 0.0, 0.1)), left, DT)
        left -= DT
    pose = foot.pose(0.0, left)
    assert pose.position[2] == pytest.approx(-0.2 * foot.late) and foot.late > 0.09
    assert pose.rate[2] == -0.2
    assert yaw_of(pose.rotation) == pytest.approx(0.1)


def test_the_shorter_way_round() -> None:
    foot = SwingFoot(
        Motion.rest(np.array((0.0, 0.0, 3.1))), 0.0, np.array((0.0, 0.0, 1.0)), 0.05, 0.2
    )
    foot = foot.advanced(np.array((0.0, 0.0, -3.1)), 0.03, 0.03)
    assert foot.level.value[2] == pytest.approx(2 * np.pi - 3.1)


def test_soles_are_laid_on_slopes() -> None:
    normal = np.array((-0.1, 0.05, 1.0)) / np.linalg.norm((-0.1, 0.05, 1.0))
    R = upright_on(normal) @ turned(0.7)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(R[:, 2], normal, atol=1e-12)
