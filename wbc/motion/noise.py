"""The noise of a recording, estimated from the recording itself.

It is taken to be white: independent from row to row, with one standard deviation per channel.
:mod:`wbc.motion.uncertainty` propagates it to the pendulum.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.special import gammaincinv

from wbc.errors import InvalidInputError
from wbc.motion.filtering import edge_rows, low_pass
from wbc.robot import Robot
from wbc.robot.limits import BASE_NQ
from wbc.robot.series import revolute_joints
from wbc.rotations import conjugate_product
from wbc.validate import Array, finite_array, read_only, set_fields

# Differences of this order keep white noise and 1e-5 of a sine of 5 Hz sampled at 200 Hz.
ORDER = 6
WINDOW = 64  # rows; the median over such windows ignores a touchdown or a frozen row
COLOURED_RATIO = 1.5  # of a residual to that of white noise: then the noise is not white
ROUNDING = 1e-9  # rad or m: less noise is rounding
MIN_PERIODS = 8.0  # of twice the cutoff: the residual of a shorter recording is mostly ends
SPLINE_ROWS = 40  # reach of the spline's ends, which fade by 0.43 a row
COLUMNS_PER_BATCH = 256
REVERSED_TIME = np.array([1.0, -1.0, 1.0])  # signs of value, velocity, acceleration


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard deviations of a recording's channels, of noise independent from row to row.

    Raises
    ------
    InvalidInputError
        Arrays of other shapes, not finite, or negative.
    """

    joints: Array  # (nv-6,) [rad or m]
    position: Array  # of the base, along world axes (3,) [m]; 0 if it was not recorded
    rotation: Array  # of the base, about its own axes (3,) [rad]; 0 if it was not recorded
    # Whether it is larger near the cutoff than at high frequencies: the recording was smoothed, or
    # its noise is not white. The standard deviations are then those near the cutoff.
    coloured: bool = False

    def __post_init__(self) -> None:
        sizes = {"joints": len(self.joints), "position": 3, "rotation": 3}
        for name, size in sizes.items():
            values = read_only(finite_array(f"noise: {name}", getattr(self, name), (size,)))
            if (values < 0.0).any():
                raise InvalidInputError(f"noise: {name}: standard deviations must not be negative")
            set_fields(self, **{name: values})

    def typical(self, robot: Robot) -> dict[str, tuple[float, str]]:
        """Return the medians over channels with noise, each with its unit, by kind."""
        revolute = revolute_joints(robot)
        kinds = {
            "joints": (self.joints[revolute], "rad"),
            "sliding joints": (self.joints[~revolute], "m"),
            "base position": (self.position, "m"),
            "base rotation": (self.rotation, "rad"),
        }
        return {
            name: (float(np.median(values[values > 0.0])), unit)
            for name, (values, unit) in kinds.items()
            if (values > 0.0).any()
        }


class CorrelatedNoise(Protocol):
    """Errors of a posture that are correlated, among its coordinates or over time."""

    @property
    def constant(self) -> Array:
        """(nv, k): a root of the covariance of constant errors.

        Of the base along world axes [m], about its own axes [rad], of joints [rad or m].
        """
        ...

    @property
    def late(self) -> float:
        """Standard deviation of the clock [s]."""
        ...

    def recorded(self) -> Noise:
        """Return the standard deviations of the channels, unfiltered."""
        ...

    def filtered(self, cutoff: float | None) -> tuple[Array, Array]:
        """Return a covariance (3, 3) and a root (nv, k) of the errors after the low-pass [Hz].

        The root times k independent errors gives those in the posture's tangent space; the
        covariance is that of value, velocity and acceleration of one of these.
        """
        ...


def estimate_noise(rows: Array, rate: float, cutoff: float | None) -> Noise:
    """Return the noise of a recording's rows (n, nv+1): base position, quaternion xyzw, joints.

    From the sixth differences of each channel, which are small in a smooth motion; or from the
    residual above twice the cutoff, if that is clearly larger than such noise explains.

    ``rows``: evenly sampled but for jitter, unwrapped, not filtered; constant where not recorded.
    ``rate``, ``cutoff``: of the rows, and of the low-pass that follows [Hz].
    """
    found = difference_noise(rows)
    found = np.where(found < ROUNDING, 0.0, found)
    coloured = np.zeros(len(found), dtype=bool)
    band = None if cutoff is None else min(2.0 * cutoff, 0.4 * rate)
    if band is not None and len(rows) > MIN_PERIODS * rate / band:
        residual = to_tangent(rows, rows - low_pass(rows, rate, band))
        impulse = _impulse(2 * edge_rows(len(rows), rate, band) + 1)
        near = _deviation(residual, impulse - low_pass(impulse[:, None], rate, band)[:, 0])
        coloured = (near > COLOURED_RATIO * found) & (near > ROUNDING)
        found = np.where(coloured, near, found)
    return Noise(found[6:], found[:3], found[3:6], bool(coloured.any()))


def difference_noise(rows: Array) -> Array:
    """Return the standard deviations (nv,) of white noise in rows, by sixth differences."""
    half = ORDER // 2
    differences = to_tangent(rows[half:-half], np.diff(rows, ORDER, axis=0))
    return _deviation(differences, np.diff(_impulse(2 * ORDER + 1), ORDER))


def to_tangent(rows: Array, differences: Array) -> Array:
    """Return differences of rows (n, nv+1) in the tangent space (n, nv), rotations in body axes."""
    rotation = 2.0 * conjugate_product(rows[:, 3:BASE_NQ], differences[:, 3:BASE_NQ])
    return np.hstack((differences[:, :3], rotation, differences[:, BASE_NQ:]))


def _impulse(count: int) -> Array:
    """Return an impulse in the middle of ``count`` rows."""
    return np.eye(1, count, count // 2)[0]


def _deviation(filtered: Array, impulse: Array) -> Array:
    """Return the standard deviations (k,) of white noise from its filtered values (n, k).

    By the filter's impulse response, and the median of the mean squares of windows, which are chi^2
    distributed with the equivalent number of independent values as degrees of freedom.
    """
    correlation = np.correlate(impulse, impulse, "full")
    energy = float(impulse @ impulse)
    windows = np.array_split(filtered**2, max(1, len(filtered) // WINDOW))
    squares = np.median([window.mean(axis=0) for window in windows], axis=0)
    if len(windows) > 2:
        freedom = len(filtered) / len(windows) * energy**2 / float(correlation @ correlation)
        squares = squares * freedom / (2.0 * gammaincinv(0.5 * freedom, 0.5))
    return np.sqrt(squares / energy)


@dataclass(frozen=True, eq=False)
class FilteredNoise:
    """A recording's noise, and its covariances after filter and differentiation.

    Both are linear in the recording's rows, so the output is Gaussian: a row's covariance is the
    energy of the filter's impulse responses, away from the ends the same in all rows.
    """

    recorded: Noise
    # Of noise of variance 1 (n, 3 p, 3 p): see noise_covariances. With p = 2 passes, the base went
    # through the filter twice.
    covariances: Array
    # Roots (nv, k) of the covariance of errors that are correlated among the channels, in place of
    # the standard deviations of ``recorded``; and of constant errors.
    root: Array | None = None
    constant: Array | None = None
    late: float = 0.0  # standard deviation of the clock [s]


def noise_covariances(count: int, rate: float, cutoff: float | None, passes: int = 1) -> Array:
    """Return covariances (n, 3 p, 3 p) of noise of variance 1, filtered and differentiated.

    Of value, velocity and acceleration in each row, in units of the noise and s, after each of the
    ``passes`` p of the filter.

    ``count``: rows n of the recording.
    ``rate``, ``cutoff``: of the rows, and of the low-pass [Hz]; None: there is none.
    """
    if cutoff is None:
        passes, edge = 1, SPLINE_ROWS
    else:
        edge = edge_rows(count, rate, cutoff) + SPLINE_ROWS
    # So long that neither end affects the other or the middle.
    short = min(count, 3 * passes * edge)
    time = np.arange(short) / rate
    found = np.zeros((short, 3 * passes, 3 * passes))
    for first in range(0, short, COLUMNS_PER_BATCH):
        noise: Array = np.eye(short, min(COLUMNS_PER_BATCH, short - first), -first)
        parts = []
        for _ in range(passes):
            noise = low_pass(noise, rate, cutoff)
            curve = make_interp_spline(time, noise, k=5)
            parts += [curve(time, order) for order in range(3)]
        responses = np.stack(parts, axis=1)  # (rows, 3 passes, columns)
        found += responses @ np.swapaxes(responses, 1, 2)
    if short == count:
        return found
    row = np.arange(count)
    mirrored = row > count - 1 - row
    nearest = np.minimum(np.minimum(row, count - 1 - row), short // 2)
    signs = np.where(mirrored[:, None], np.tile(REVERSED_TIME, passes), 1.0)
    return np.asarray(signs[:, :, None] * found[nearest] * signs[:, None, :])
