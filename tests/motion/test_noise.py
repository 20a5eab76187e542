"""A recording's noise: estimated, filtered, and told from motion."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from wbc.errors import InvalidInputError
from wbc.motion import Motion, Noise, analyze
from wbc.motion.filtering import low_pass
from wbc.motion.noise import estimate_noise, noise_covariances
from wbc.motion.residual_analysis import resolve_cutoff
from wbc.robot import Robot

RATE = 200.0
TIME = np.arange(1200) / RATE


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
def test_filtered_noise_has_the_energy_of_all_impulse_responses(
    count: int, cutoff: float | None, passes: int
) -> None:
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
