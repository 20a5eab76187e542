"""The curve of least jerk: its ends, and its rates by differences."""

import numpy as np
import pytest

from wbc.minimum_jerk import PEAK, minimum_jerk, minimum_jerk_rates


def test_it_goes_from_rest_to_rest() -> None:
    assert (minimum_jerk(0.0), minimum_jerk(1.0)) == (0.0, 1.0)
    assert minimum_jerk_rates(0.0) == minimum_jerk_rates(1.0) == (0.0, 0.0)


@pytest.mark.parametrize("x", np.linspace(0.05, 0.95, 10))
def test_rates_are_those_of_the_curve(x: float) -> None:
    h = 1e-4
    before, here, after = (minimum_jerk(x + k * h) for k in (-1, 0, 1))
    slope, bend = minimum_jerk_rates(x)
    # Central differences: h^2 / 6 times a third derivative of up to 60, and rounding / h^2.
    assert slope == pytest.approx((after - before) / (2 * h), abs=1e-6)
    assert bend == pytest.approx((after - 2 * here + before) / h**2, abs=1e-6)


def test_the_peak_is_the_largest_slope() -> None:
    slopes = [minimum_jerk_rates(x)[0] for x in np.linspace(0.0, 1.0, 101)]
    assert max(slopes) == pytest.approx(PEAK, rel=1e-12)
