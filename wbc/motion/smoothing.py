"""From a recording to configurations, velocities and accelerations at even times.

A recording is resampled on an even grid at its own rate (cubic spline, only if it is uneven),
filtered forward and backward, and interpolated by a quintic spline, which gives values, velocities
and accelerations at the wanted rate. So nothing is filtered twice: a Savitzky-Golay derivative
would be a second low-pass, whose passband depends on its window, whereas the quintic spline's
second derivative is exact to (w h)^4 / 360 for a sine of w rad/s sampled every h s (4e-6 at 1 Hz,
200 Hz).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from wbc.errors import InvalidInputError, shown
from wbc.motion.dropouts import check_count, unwrap
from wbc.motion.filtering import low_pass
from wbc.motion.noise import (
    CorrelatedNoise,
    FilteredNoise,
    Noise,
    difference_noise,
    estimate_noise,
    noise_covariances,
    to_tangent,
)
from wbc.motion.planted_base import planted_base
from wbc.motion.recording import Motion
from wbc.robot import Robot
from wbc.robot.limits import BASE_NQ, BASE_NV
from wbc.robot.series import Progress
from wbc.rotations import conjugate_product, rotations_from
from wbc.validate import Array, finite_number

RESIDUAL = "residual"  # in place of a cutoff
MIN_PERIODS = 4.0  # of the cutoff in the recording
MAX_CUTOFF = 0.4  # by the rate
MIN_NOISE = 1e-5  # rad or m: a channel with less must not outweigh all others
BISECTIONS = 12  # of the logarithm: to 0.1 %
EVEN_TOLERANCE = 1e-3  # of a step, between times and an even grid


def resolve_cutoff(cutoff: float | str | None, rows: Array, rate: float) -> float | None:
    """Return the cutoff [Hz] as given, or by residual analysis of all channels together.

    The residual of too high a cutoff is noise alone; of too low a cutoff, noise and motion. At the
    best one the residual's rms is that of all the noise (Winter, Biomechanics and Motor Control,
    3.4.4.3), which is estimated from the recording's differences, not read off a line by eye. Each
    channel's residual counts in units of its noise, or of 1e-5 rad or m if it has less.

    ``rows``: base position, quaternion xyzw and joints (n, nv+1), evenly sampled, not filtered;
    constant where not recorded.
    ``rate``: of the rows [Hz].
    """
    if not isinstance(cutoff, str):
        return cutoff
    if cutoff != RESIDUAL:
        raise InvalidInputError(
            f"cutoff: expected a frequency in Hz, None or {RESIDUAL!r}, got {shown(cutoff)}"
        )
    low, high = MIN_PERIODS * rate / len(rows), MAX_CUTOFF * rate
    if low >= high:
        raise InvalidInputError(
            f"cutoff: {len(rows)} rows are too few for a residual analysis; give it in Hz"
        )
    unit = np.maximum(difference_noise(rows), MIN_NOISE)
    spread = np.ptp(rows, axis=0)
    rotation = np.full(3, spread[3:BASE_NQ].max())  # the quaternion's four entries are three angles
    moving = np.concatenate((spread[:3], rotation, spread[BASE_NQ:])) > 0.0
    for _ in range(BISECTIONS):
        middle = float(np.sqrt(low * high))
        residual = to_tangent(rows, rows - low_pass(rows, rate, middle)) / unit
        if moving.any() and np.mean(residual[:, moving] ** 2) > 1.0:
            low = middle
        else:
            high = middle
    return high


@dataclass(frozen=True, eq=False)
class SmoothMotion:
    """A smooth motion at even times."""

    time: Array  # (n,) [s]
    # q, v and acceleration: configurations (n, nq), velocities and their rates (n, nv); the
    # base's in base axes.
    q: Array
    v: Array
    acceleration: Array
    # Planted foot (n,), index among robot.feet; None if the base was recorded.
    planted: NDArray[np.intp] | None
    cutoff: float | None  # of the low-pass [Hz]
    bandwidth: float  # of the filtered noise [Hz]
    noise: FilteredNoise | None  # None: not requested


def smooth_trajectory(
    motion: Motion,
    rate: float | None,
    cutoff: float | str | None,
    planted: str | None,
    height: float,
    noise: Noise | CorrelatedNoise | str | None,
    progress: Progress | None = None,
) -> SmoothMotion:
    """Return the trajectory of a recorded motion; see :func:`wbc.motion.analyze`."""
    if (motion.base is None) == (planted is None):
        raise InvalidInputError(
            f"{motion.source}: the base was not recorded; name the planted foot: left, right or"
            " auto"
            if motion.base is None
            else f"{motion.source}: the base was recorded; leave planted out"
        )
    grid, own_rate = even_grid(motion.time)
    joints = motion.joints.copy()
    base: Array = np.empty((len(motion.time), BASE_NQ))
    base[:] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0) if motion.base is None else motion.base
    unwrap(motion.robot, joints, base[:, 3:])
    rows = np.hstack((base, joints))
    rows_on_grid = resample(motion.time, rows, grid)
    cutoff = resolve_cutoff(cutoff, rows_on_grid, own_rate)
    smooth = low_pass(rows_on_grid, own_rate, cutoff)
    foot, passes = None, 1
    if planted is not None:
        q = _configurations(motion.robot, smooth)
        base, foot = planted_base(motion.robot, grid, q, planted, height, progress)
        if cutoff is not None and (foot != foot[0]).any():
            # The base has kinks where the planted foot changes, which the joints' filter left.
            base, passes = low_pass(base, own_rate, cutoff), 2
        smooth = np.hstack((base, smooth[:, BASE_NQ:]))
    smooth[:, 3:BASE_NQ] /= np.linalg.norm(smooth[:, 3:BASE_NQ], axis=1)[:, None]
    time = grid if rate is None else sample_times(grid, finite_number("rate", rate, above=0.0))
    nearest = np.minimum(np.rint((time - grid[0]) * own_rate).astype(int), len(grid) - 1)
    q, v, acceleration = _differentiate(motion.robot, grid, smooth, time)
    filtered = None
    if noise is not None and not isinstance(noise, Noise | str):
        covariance, root = noise.filtered(cutoff)
        # Near the ends it grows like white noise.
        white = np.diagonal(noise_covariances(len(grid), own_rate, cutoff), axis1=1, axis2=2)
        growth = np.sqrt(white / white[len(white) // 2])[nearest]
        covariances = growth[:, :, None] * covariance * growth[:, None]
        filtered = FilteredNoise(noise.recorded(), covariances, root, noise.constant, noise.late)
    elif noise is not None:
        if not isinstance(noise, Noise):
            noise = estimate_noise(rows, motion.rate, cutoff)
        # A grid with more rows than the recording keeps the spectral density of its noise.
        density = (len(grid) - 1) / (len(motion.time) - 1)
        covariances = noise_covariances(len(grid), own_rate, cutoff, passes)
        filtered = FilteredNoise(noise, density * covariances[nearest])
    return SmoothMotion(
        time=time,
        q=q,
        v=v,
        acceleration=acceleration,
        planted=None if foot is None else foot[nearest],
        cutoff=cutoff,
        bandwidth=0.5 * own_rate if cutoff is None else cutoff,
        noise=filtered,
    )


def smooth_forces(time: Array, forces: Array, at: Array, cutoff: float | None) -> Array:
    """Return measured forces (n, k) at other times (m,) [s], filtered as the motion is: (m, k).

    Interpolation is linear, since forces jump at touchdown.
    """
    grid, rate = even_grid(time)
    return _interpolate(grid, low_pass(_interpolate(time, forces, grid), rate, cutoff), at)


def _interpolate(time: Array, values: Array, at: Array) -> Array:
    return np.column_stack([np.interp(at, time, column) for column in values.T])


def _configurations(robot: Robot, rows: Array) -> Array:
    """Return configurations q (n, nq) of rows (n, nv+1) of base and joint angles."""
    limits = robot.limits
    q = np.empty((len(rows), robot.nq))
    q[:, :BASE_NQ] = rows[:, :BASE_NQ]
    q[:, list(limits.starts)] = rows[:, BASE_NQ:]
    for k in limits.unbounded:
        start, angle = limits.starts[k], rows[:, BASE_NQ + k]
        q[:, start], q[:, start + 1] = np.cos(angle), np.sin(angle)
    return q


def _differentiate(
    robot: Robot, grid: Array, rows: Array, time: Array
) -> tuple[Array, Array, Array]:
    """Return q, v and the rate of v at some times, by a spline through rows (m, nv+1)."""
    curve = make_interp_spline(grid, rows, k=5)
    values, first, second = (curve(time, order) for order in range(3))
    quaternion = values[:, 3:BASE_NQ]
    omega, omega_rate = angular_rates(quaternion, first[:, 3:BASE_NQ], second[:, 3:BASE_NQ])
    values[:, 3:BASE_NQ] = quaternion / np.linalg.norm(quaternion, axis=1)[:, None]
    to_base = np.swapaxes(rotations_from(values[:, 3:BASE_NQ]), 1, 2)
    v, acceleration = np.empty((len(time), robot.nv)), np.empty((len(time), robot.nv))
    v[:, :3] = (to_base @ first[:, :3, None])[..., 0]
    v[:, 3:6], v[:, BASE_NV:] = omega, first[:, BASE_NQ:]
    # The second term is due to the rotating axes.
    acceleration[:, :3] = (to_base @ second[:, :3, None])[..., 0] - np.cross(omega, v[:, :3])
    acceleration[:, 3:6], acceleration[:, BASE_NV:] = omega_rate, second[:, BASE_NQ:]
    return _configurations(robot, values), v, acceleration


# ---------------------------------------------------------------------- sampling


def even_grid(time: Array) -> tuple[Array, float]:
    """Return an even grid (m,) from the first time on, and its rate [Hz].

    If ``time`` (n,) is even but for rounding, m = n; else the grid has the median step, and ends at
    or before the last time.
    """
    count = len(time) - 1
    step = float(time[-1] - time[0]) / count
    grid = np.asarray(time[0] + step * np.arange(count + 1))
    if not _same_times(time, grid):
        grid = sample_times(time, 1.0 / float(np.median(np.diff(time))))
    return grid, (len(grid) - 1) / float(grid[-1] - grid[0])


def sample_times(time: Array, rate: float) -> Array:
    """Return the times (m,) within ``time`` (n,) at ``rate`` [Hz], from its first on."""
    seconds = float(time[-1] - time[0])
    if seconds * rate < 1.0 - 1e-9:
        raise InvalidInputError(
            f"rate: {rate:g} Hz gives only one frame in {seconds:.4g} s; choose a higher one"
        )
    check_count(f"rate: {rate:g} Hz", seconds, 1.0 / rate)
    count = int(np.floor((time[-1] - time[0]) * rate * (1.0 + 1e-12) + 1e-9))
    return np.minimum(time[0] + np.arange(count + 1) / rate, time[-1])


def resample(time: Array, values: Array, grid: Array) -> Array:
    """Return values (m, k) at the times of a grid, by a cubic spline through (n, k)."""
    if _same_times(time, grid):
        return values
    return np.asarray(make_interp_spline(time, values, k=3)(grid))


def _same_times(time: Array, grid: Array) -> bool:
    """Return whether times (n,) are those of an even grid, but for rounding."""
    if len(time) != len(grid):
        return False
    most = EVEN_TOLERANCE * float(grid[-1] - grid[0]) / (len(grid) - 1)
    return float(np.abs(time - grid).max()) <= most


def angular_rates(quaternion: Array, first: Array, second: Array) -> tuple[Array, Array]:
    """Return angular velocity and acceleration (n, 3) in body axes [rad/s, rad/s^2].

    Of the rotation p / |p|, given p and its derivatives (n, 4), xyzw: with conjugate p* and vector
    part [.], w = 2 [p* p'] / |p|^2 and w' = 2 [p* p''] / |p|^2 - w (|p|^2)' / |p|^2.
    """
    square = (quaternion * quaternion).sum(axis=1)[:, None]
    square_rate = 2.0 * (quaternion * first).sum(axis=1)[:, None]
    w = 2.0 * conjugate_product(quaternion, first) / square
    return w, 2.0 * conjugate_product(quaternion, second) / square - w * square_rate / square
