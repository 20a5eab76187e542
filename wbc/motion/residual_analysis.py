"""A low-pass' cutoff chosen by residual analysis (Winter, Biomechanics and Motor Control, 3.4.4.3).

The residual of too high a cutoff is noise alone; of too low a cutoff, noise and motion. The cutoff
is right where as much motion is lost as noise is let through: there the residual's rms is that of
the whole noise. Winter reads the noise off a line through the residuals of high cutoffs, by eye;
here it is what the recording's differences say it is.
"""

from __future__ import annotations

import numpy as np

from wbc.errors import InvalidInputError, shown
from wbc.motion.filtering import low_passed
from wbc.motion.noise import difference_noise, in_tangent
from wbc.robot.limits import BASE_NQ
from wbc.validate import Array

RESIDUAL = "residual"  # in place of a cutoff
PERIODS = 4.0  # of the lowest cutoff in the recording, at least
HIGHEST = 0.4  # of the rate
# rad or m: less noise is as good as none; a channel without any must not rule all others.
LEAST_NOISE = 1e-5
STEPS = 12  # of the bisection, in octaves: to 0.1 %


def chosen_cutoff(cutoff: float | str | None, rows: Array, rate: float) -> float | None:
    """Return the cutoff [Hz] as given, or what ``"residual"`` finds for all channels together.

    Each channel's residual counts in units of its noise, or of 1e-5 rad or m if it has less.

    Parameters
    ----------
    rows:
        Base position, quaternion xyzw and joints (n, nv+1), evenly sampled, not filtered; what was
        not recorded is constant.
    rate:
        Of the rows [Hz].

    Raises
    ------
    InvalidInputError
        Another word than ``residual``, or a recording too short for any choice.
    """
    if not isinstance(cutoff, str):
        return cutoff
    if cutoff != RESIDUAL:
        raise InvalidInputError(
            f"cutoff: expected a frequency in Hz, None or {RESIDUAL!r}, got {shown(cutoff)}"
        )
    low, high = PERIODS * rate / len(rows), HIGHEST * rate
    if low >= high:
        raise InvalidInputError(
            f"cutoff: {len(rows)} rows are too few for a residual analysis; give it in Hz"
        )
    unit = np.maximum(difference_noise(rows), LEAST_NOISE)
    spread = np.ptp(rows, axis=0)
    turning = np.full(3, spread[3:BASE_NQ].max())  # the quaternion's four make three angles
    moving = np.concatenate((spread[:3], turning, spread[BASE_NQ:])) > 0.0
    for _ in range(STEPS):
        middle = float(np.sqrt(low * high))
        rest = in_tangent(rows, rows - low_passed(rows, rate, middle)) / unit
        if moving.any() and np.mean(rest[:, moving] ** 2) > 1.0:
            low = middle
        else:
            high = middle
    return high
