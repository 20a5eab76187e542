"""A recording's noise: estimated, filtered, told from motion; filter and derivatives."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from wbc.errors import InvalidInputError
from wbc.motion import Motion, Noise, analyze
from wbc.motion.filtering import low_pass
from wbc.motion.noise import estimate_noise, noise_covariances
from wbc.motion.smoothing import angular_rates, even_grid, resample, resolve_cutoff, sample_times
from wbc.robot import Robot

RATE = 200.0
TIME = np.arange(1200) / RATE
INNER = slice(100, -100)  # half a second off both ends, five periods of the cutoff


def recorded(rng: np.random.Generator, sizes: tuple[float, float, float]) -> np.ndarray:
    """Rows of a turning base and 20 joints that swing at up to 1.5 Hz, with noise on all three."""
    position, rotation, joint = sizes
    base = 0.1 * np.sin(6.0 * TIME[:, None] + [0.0, 1.0, 2.0])
    turn = Rotation.from_euler("xyz", np.column_stack((base[:, :2], 1.5 * TIME)))
    turn = turn * Rotation.from_rotvec(rotation * rng.normal(size=(len(TIME), 3)))
    quaternion = turn.as_quat()
    flips = np.cumprod(np.where((quaternion[1:] * quaternion[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
    quaternion[1:] *= flips[:, None]
    joints = 0.5 * np.sin(np.linspace(2.0, 9.0, 20) * TIME[:, None] + np.arange(20))
    joints += joint * rng.normal(size=joints.shape)
    return np.hstack((base + position * rng.normal(size=base.shape), quaternion, joints))


# ---------------------------------------------------------------------- estimate


def test_noise_of_known_size_is_found(rng: np.random.Generator) -> None:
    noise = estimate_noise(recorded(rng, (2e-3, 5e-4, 1e-3)), RATE, 10.0)
    # 1200 rows of sixth differences are worth 380 independent values, whose windows' median is
    # right to 5 % (one standard deviation); four of them for the worst of 26.
    np.testing.assert_allclose(noise.position, 2e-3, rtol=0.2)
    np.testing.assert_allclose(noise.rotation, 5e-4, rtol=0.2)
    np.testing.assert_allclose(noise.joints, 1e-3, rtol=0.2)
    assert np.mean(noise.joints) == pytest.approx(1e-3, rel=0.04)
    assert not noise.coloured


def test_motion_is_not_taken_for_noise(rng: np.random.Generator) -> None:
    rows = recorded(rng, (0.0, 0.0, 0.0))
    # What the differences leave of 0.5 rad at 9 rad/s: (w h)^6 / sqrt(924) of it, 1.4e-10.
    clean = estimate_noise(rows, RATE, 10.0)
    assert max(clean.joints.max(), clean.position.max(), clean.rotation.max()) < 1e-8
    # A landing that shakes all joints for 0.1 s, a row lost now and then, and a frozen half second.
    rows = recorded(rng, (0.0, 0.0, 1e-3))
    rows[600:620, 7:] += 0.05 * rng.normal(size=(20, 20))
    rows[700:800, 7:] = rows[700, 7:]
    found = estimate_noise(rows, RATE, 10.0)
    assert np.mean(found.joints) == pytest.approx(1e-3, rel=0.1)


def test_noise_smoothed_before_is_found_near_the_cutoff(rng: np.random.Generator) -> None:
    rows = recorded(rng, (0.0, 0.0, 0.0))
    rows[:, 7:] += low_pass(1e-3 * rng.normal(size=(1200, 20)), RATE, 30.0)
    noise = estimate_noise(rows, RATE, 10.0)
    assert noise.coloured
    # Of the band from 20 to 100 Hz, what lies below 30 Hz is left: an eighth of the energy.
    assert 2e-4 < np.mean(noise.joints) < 6e-4


@pytest.mark.parametrize(
    ("joints", "words"), [(np.full(25, -1e-3), "not be negative"), (np.full(25, np.nan), "joints")]
)
def test_bad_noise_is_refused(joints: np.ndarray, words: str) -> None:
    with pytest.raises(InvalidInputError, match=words):
        Noise(joints, np.zeros(3), np.zeros(3))


def test_noise_as_given_is_checked_against_the_robot(hoap2: Robot) -> None:
    stand = np.tile(hoap2.postures["standing"], (50, 1))
    motion = Motion(hoap2, TIME[:50], stand[:, 7:], stand[:, :7])
    given = Noise(np.full(25, 1e-3), np.zeros(3), np.zeros(3))
    assert analyze(motion, noise=given).uncertainty.noise is given
    for wrong in (1e-3, "guessed"):
        with pytest.raises(InvalidInputError, match="noise: expected"):
            analyze(motion, noise=wrong)
    with pytest.raises(InvalidInputError, match="noise: joints"):
        analyze(motion, noise=Noise(np.full(3, 1e-3), np.zeros(3), np.zeros(3)))


# ---------------------------------------------------------------------- through the filter


@pytest.mark.parametrize(
    ("count", "cutoff", "passes"), [(900, 10.0, 1), (900, None, 1), (900, 15.0, 2), (60, 8.0, 1)]
)
def test_filtered_noise_has_the_energy_of_all_impulse_responses(count, cutoff, passes) -> None:
    """Against the whole recording's linear map, one impulse in each of its rows."""
    values, parts = np.eye(count), []
    for _ in range(passes):
        values = low_pass(values, RATE, cutoff)
        curve = make_interp_spline(np.arange(count) / RATE, values, k=5)
        parts += [curve(np.arange(count) / RATE, order) for order in range(3)]
    responses = np.stack(parts, axis=1)
    exact = responses @ np.swapaxes(responses, 1, 2)
    found = noise_covariances(count, RATE, cutoff, passes)
    size = np.sqrt(np.einsum("nii->ni", exact))
    error = np.abs(found - exact) / (size[:, :, None] * size[:, None, :])
    # What one end and the middle know of the other end: the filter's tail after 3 periods.
    assert error.max() < 1e-4


# ---------------------------------------------------------------------- residual analysis


@pytest.mark.parametrize("top", [1.0, 4.0, 12.0])
def test_residual_cutoff_is_near_the_best(top: float, rng: np.random.Generator) -> None:
    """Against the cutoff that in hindsight brings joints nearest to the motion without noise."""
    rows = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (1200, 1))
    swings = 0.1 * np.sin(2.0 * np.pi * top * np.linspace(0.4, 1.0, 8) * TIME[:, None])
    clean = np.hstack((rows, swings))
    noisy = np.hstack((rows, swings + 2e-3 * rng.normal(size=swings.shape)))
    inner = slice(150, -150)

    def error(cutoff: float) -> float:
        return float(np.sqrt(np.mean((low_pass(noisy, RATE, cutoff) - clean)[inner, 7:] ** 2)))

    found = resolve_cutoff("residual", noisy, RATE)
    best = min(error(cutoff) for cutoff in np.geomspace(1.0, 80.0, 60))
    # Winter's rule weighs what is lost against what is let through, it does not minimise their sum:
    # at the balance each is as large as the other, so at worst sqrt(2) of either alone.
    assert error(found) < 1.45 * best
    assert top < found < 8.0 * top


def test_residual_cutoff_of_a_recording_without_noise_keeps_all() -> None:
    rows = np.zeros((600, 10))
    rows[:, 6] = 1.0
    rows[:, 7:] = np.sin(2.0 * np.pi * 15.0 * TIME[:600, None] + np.arange(3))
    assert resolve_cutoff("residual", rows, RATE) > 40.0


def test_unknown_cutoff_words_are_refused() -> None:
    rows = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.3], (9, 1))
    assert resolve_cutoff(7.0, rows, RATE) == 7.0
    assert resolve_cutoff(None, rows, RATE) is None
    with pytest.raises(InvalidInputError, match="'residual', got 'winter'"):
        resolve_cutoff("winter", rows, RATE)
    with pytest.raises(InvalidInputError, match="9 rows are too few"):
        resolve_cutoff("residual", rows, RATE)


def sines(time: np.ndarray, order: int = 0) -> np.ndarray:
    """Order-th derivative of sines of 0.3 to 1.5 Hz with various phases, (n, 4)."""
    w = 2.0 * np.pi * np.array([0.3, 0.7, 1.0, 1.5])
    return w**order * np.sin(np.outer(time, w) + [0.1, 1.0, 2.0, 4.0] + 0.5 * np.pi * order)


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


def test_filter_has_no_phase() -> None:
    """An impulse in the middle comes out symmetric, about its place."""
    impulse = np.zeros((601, 1))
    impulse[300] = 1.0
    answer = low_pass(impulse, RATE, 10.0)[:, 0]
    assert answer.argmax() == 300
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


JITTERING = TIME + 1e-3 * np.sin(np.arange(len(TIME)) ** 2)


@pytest.mark.parametrize("time", [JITTERING, np.round(np.arange(90) / 30.0, 3)])
def test_uneven_times_are_resampled_onto_as_many(time: np.ndarray) -> None:
    """They were taken for even ones, the rows of 3 s at 30 Hz for those of 2.97 s."""
    grid = even_grid(time)[0]
    assert len(grid) == len(time)
    np.testing.assert_allclose(resample(time, sines(time), grid), sines(grid), atol=1e-4)


def test_even_times_are_kept() -> None:
    rounded = np.round(TIME + 7.0, 6)
    assert len(even_grid(rounded)[0]) == len(rounded)
    values = sines(TIME)
    assert resample(rounded, values, even_grid(rounded)[0]) is values
    assert len(sample_times(TIME, 100.0)) == 600
    assert sample_times(TIME, 50.0)[-1] <= TIME[-1]
