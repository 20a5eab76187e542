"""A low-pass' cutoff chosen by residual analysis (Winter, Biomechanics and Motor Control, 3.4.4.3).

The residual of too high a cutoff is noise alone; of too low a cutoff, noise and motion. The best
cutoff removes as much motion as it passes noise: there the residual's rms is that of all the noise.
Winter reads the noise off a line through the residuals of high cutoffs, by eye; here it is
estimated from the recording's differences.
"""

from __future__ import annotations

import numpy as np

from wbc.errors import InvalidInputError, shown
from wbc.motion.filtering import low_pass
from wbc.motion.noise import difference_noise, to_tangent
from wbc.robot.limits import BASE_NQ
from wbc.validate import Array

RESIDUAL = "residual"  # in place of a cutoff
MIN_PERIODS = 4.0  # of the cutoff in the recording
MAX_CUTOFF = 0.4  # by the rate
MIN_NOISE = 1e-5  # rad or m: a channel with less must not outweigh all others
BISECTIONS = 12  # of the logarithm: to 0.1 %


def resolve_cutoff(cutoff: float | str | None, rows: Array, rate: float) -> float | None:
    """Return the cutoff [Hz] as given, or by residual analysis of all channels together.

    Each channel's residual counts in units of its noise, or of 1e-5 rad or m if it has less.

    Parameters
    ----------
    rows:
        Base position, quaternion xyzw and joints (n, nv+1), evenly sampled, not filtered; constant
        where not recorded.
    rate:
        Of the rows [Hz].
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
