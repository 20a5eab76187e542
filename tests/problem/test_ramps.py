"""Minimum-jerk ramps against finite differences and against the polynomial's own conditions."""

import numpy as np
import pytest

from wbc.problem.ramps import MinimumJerk

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


def test_it_never_overshoots() -> None:
    path = np.array([RAMP.at(t)[0][0] for t in np.linspace(0, 1.7, 200)])
    assert (np.diff(path) >= 0.0).all()
    assert path.min() == 1.0
    assert path.max() == 3.0
