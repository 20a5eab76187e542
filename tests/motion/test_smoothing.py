"""Filter and derivatives on motions known in closed form."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from wbc.errors import InvalidInputError
from wbc.motion.filtering import low_pass
from wbc.motion.smoothing import angular_rates, even_grid, resample, sample_times

RATE = 200.0
TIME = np.arange(1200) / RATE
INNER = slice(100, -100)  # half a second off both ends, five periods of the cutoff


def sines(time: np.ndarray, order: int = 0) -> np.ndarray:
    """Order-th derivative of sines of 0.3 to 1.5 Hz with various phases, (n, 4)."""
    w = 2.0 * np.pi * np.array([0.3, 0.7, 1.0, 1.5])
    return w**order * np.sin(np.outer(time, w) + [0.1, 1.0, 2.0, 4.0] + 0.5 * np.pi * order)


def test_derivatives_of_sines_through_the_filter() -> None:
    curve = make_interp_spline(TIME, low_pass(sines(TIME), RATE, 10.0), k=5)
    for order, tolerance in ((0, 2e-6), (1, 2e-6), (2, 1e-5)):
        exact = sines(TIME, order)
        error = np.abs(curve(TIME, order) - exact)[INNER] / np.abs(exact).max(axis=0)
        # The Butterworth's 1 / (1 + 0.41 (f / cutoff)^8) at 1.5 Hz is off by 1e-7; the quintic
        # spline's second derivative by (w h)^4 / 360 = 1.4e-8 there; ends fade to below 1e-6.
        assert error.max() < tolerance


def test_ends_keep_their_acceleration() -> None:
    w = 2.0 * np.pi * 0.7
    for phase in np.linspace(0.0, 6.0, 7):
        x = np.sin(w * TIME + phase)[:, None]
        second = make_interp_spline(TIME, low_pass(x, RATE, 10.0), k=5)(TIME, 2)
        assert np.abs(second + w * w * x).max() < 6e-3 * w * w  # as documented


def test_ends_keep_their_position() -> None:
    """At both ends as if the recording went on: 0.003 of the amplitude at most at 4 Hz.

    What the polynomial leaves must be turned about the last point; mirrored beside it, 0.15.
    """
    before, longer = 600, np.arange(-600, 1800) / RATE
    for phase in np.linspace(0.0, 6.0, 13):
        wave = np.sin(2.0 * np.pi * 4.0 * longer + phase)[:, None]
        whole = low_pass(wave, RATE, 10.0)[before : before + 1200]
        part = low_pass(wave[before : before + 1200], RATE, 10.0)
        assert np.abs(part - whole)[[0, -1]].max() < 5e-3


def test_ends_do_not_depend_on_the_rounding_of_the_rate(rng: np.random.Generator) -> None:
    """A row more of the extrapolation moved the force of a robot's ends by 54 N."""
    values = np.cumsum(rng.standard_normal((50, 1)), axis=0)
    apart = low_pass(values, 50.00000000000002, 6.0) - low_pass(values, 50.0, 6.0)
    assert np.abs(apart).max() < 1e-9


def test_filter_has_no_phase(rng: np.random.Generator) -> None:
    # A band of noise that fades at both ends passes; delayed by even one sample, its correlation
    # would peak elsewhere.
    band = np.convolve(rng.normal(size=3000), np.hanning(81), mode="same") * np.hanning(3000)
    passed = low_pass(band[:, None], RATE, 5.0)[:, 0]
    lags = range(-9, 10)
    correlation = [float(band @ np.roll(passed, lag)) for lag in lags]
    assert lags[int(np.argmax(correlation))] == 0
    # An impulse in the middle comes out symmetric.
    impulse = np.zeros((601, 1))
    impulse[300] = 1.0
    answer = low_pass(impulse, RATE, 10.0)[:, 0]
    np.testing.assert_allclose(answer, answer[::-1], atol=1e-9)


@pytest.mark.parametrize("cutoff", [3.0, 10.0, 40.0])
def test_the_gain_at_the_cutoff_is_3_db(cutoff: float) -> None:
    impulse = np.zeros((4001, 1))
    impulse[2000] = 1.0
    answer = low_pass(impulse, RATE, cutoff)[:, 0]
    n = np.arange(4001) - 2000
    gains = [abs(answer @ np.exp(-2j * np.pi * f / RATE * n)) for f in (0.0, cutoff, 2.0 * cutoff)]
    np.testing.assert_allclose(gains[:2], [1.0, np.sqrt(0.5)], atol=1e-6)
    assert gains[2] < 0.012  # 48 dB per octave, less 3 dB and more in a digital filter


def test_line_passes_unchanged() -> None:
    line = np.outer(TIME, [2.0, -1.0]) + 3.0
    np.testing.assert_allclose(low_pass(line, RATE, 10.0), line, atol=1e-8)
    assert low_pass(line, RATE, None) is line


@pytest.mark.parametrize("cutoff", [0.0, -1.0, 100.0, np.nan, 1e-9, 3.9])
def test_bad_cutoffs_are_refused(cutoff: float) -> None:
    with pytest.raises(InvalidInputError, match="cutoff"):
        low_pass(np.zeros((50, 1)), RATE, cutoff)


@pytest.mark.parametrize("rate", [0.1, 1e-9, 1e8])
def test_rates_with_one_frame_or_too_many_are_refused(rate: float) -> None:
    with pytest.raises(InvalidInputError, match="rate"):
        sample_times(TIME, rate)


def test_angular_velocity_of_a_tumbling_body() -> None:
    # R = Rz(a) Rx(b): body rates w = (b', a' sin b, a' cos b), by hand.
    a, b = 0.8 * np.sin(2.0 * TIME) + 3.0 * TIME, 0.6 * np.cos(3.0 * TIME)
    a1, a2 = 1.6 * np.cos(2.0 * TIME) + 3.0, -3.2 * np.sin(2.0 * TIME)
    b1, b2 = -1.8 * np.sin(3.0 * TIME), -5.4 * np.cos(3.0 * TIME)
    q = (Rotation.from_euler("z", a[:, None]) * Rotation.from_euler("x", b[:, None])).as_quat()
    flips = np.cumprod(np.concatenate(([1.0], np.sign((q[1:] * q[:-1]).sum(axis=1)))))
    curve = make_interp_spline(TIME, q * flips[:, None], k=5)
    w, rate = angular_rates(curve(TIME), curve(TIME, 1), curve(TIME, 2))
    exact = np.column_stack((b1, a1 * np.sin(b), a1 * np.cos(b)))
    exact_rate = np.column_stack(
        (b2, a2 * np.sin(b) + a1 * b1 * np.cos(b), a2 * np.cos(b) - a1 * b1 * np.sin(b))
    )
    # Quintic spline at 200 Hz of rates up to 6 rad/s: (w h)^4 / 360 = 2e-9, times w^2.
    np.testing.assert_allclose(w[INNER], exact[INNER], atol=1e-8)
    np.testing.assert_allclose(rate[INNER], exact_rate[INNER], atol=1e-6)
    # The length of a quaternion does not matter, nor how it changes.
    p, p1, p2 = curve(TIME), curve(TIME, 1), curve(TIME, 2)
    s, s1 = (2.0 + np.sin(TIME))[:, None], np.cos(TIME)[:, None]
    longer = angular_rates(
        s * p, s1 * p + s * p1, -np.sin(TIME)[:, None] * p + 2 * s1 * p1 + s * p2
    )
    np.testing.assert_allclose(longer[0], w, atol=1e-10)
    np.testing.assert_allclose(longer[1], rate, atol=1e-8)


def test_uneven_times_are_resampled(rng: np.random.Generator) -> None:
    time = TIME + rng.uniform(-0.3, 0.3, len(TIME)) / RATE
    grid = even_grid(time)[0]
    np.testing.assert_allclose(np.diff(grid), np.median(np.diff(time)))
    assert grid[0] == time[0] and time[-1] - grid[-1] < 1.0 / RATE
    # Cubic spline: 5/384 (w h)^4 with h up to 8 ms and 9.4 rad/s.
    np.testing.assert_allclose(resample(time, sines(time), grid), sines(grid), atol=2e-6)


def test_even_times_are_kept() -> None:
    rounded = np.round(TIME + 7.0, 6)
    assert len(even_grid(rounded)[0]) == len(rounded)
    values = sines(TIME)
    assert resample(rounded, values, even_grid(rounded)[0]) is values
    assert len(sample_times(TIME, 100.0)) == 600
    assert sample_times(TIME, 50.0)[-1] <= TIME[-1]
