"""Covariance of filtered white noise: values, velocities, accelerations after low-pass and spline.

Both are linear in the recording's rows, so the output is Gaussian, with one covariance among value,
velocity and acceleration in each row: the energy of the filter's impulse responses. Away from the
ends it is the same in all rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from wbc.motion.filtering import edge_rows, low_pass
from wbc.motion.noise import Noise
from wbc.validate import Array

SPLINE_ROWS = 40  # reach of the spline's ends, which fade by 0.43 a row
COLUMNS_PER_BATCH = 256
REVERSED_TIME = np.array([1.0, -1.0, 1.0])  # signs of value, velocity, acceleration


@dataclass(frozen=True, eq=False)
class FilteredNoise:
    """A recording's noise, and its covariances after filter and differentiation."""

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

    Parameters
    ----------
    count:
        Rows n of the recording.
    rate, cutoff:
        Of the rows, and of the low-pass [Hz]; None: there is none.
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
