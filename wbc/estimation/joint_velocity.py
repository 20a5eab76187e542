"""Joint velocities from encoders alone: a line fitted to the last readings, of known delay.

The arithmetic is the core's (``source/sensors.c``).
"""

from __future__ import annotations

import math

import numpy as np

from wbc.kinds import whole_number
from wbc.native import doubles, integers, lib
from wbc.validate import Array, finite_array, finite_number


class JointVelocityFilter:
    """The slope of the least-squares line through the last readings of each joint.

    Of all linear filters of this many readings that are unbiased at constant velocity, it has the
    least white noise. An accelerating joint's velocity is delayed by :attr:`delay`.

    Parameters
    ----------
    window:
        Number of readings; 2 is a plain difference.
    dt:
        Nominal time between them [s], for delay and gain; the filter uses their real times.

    Attributes
    ----------
    delay:
        (window - 1) / 2 dt [s].
    gain:
        Standard deviation of the velocity by that of a reading [1/s]: 12^(1/2) / (dt
        (n (n^2 - 1))^(1/2)), n the window.

    Raises
    ------
    InvalidInputError
        A window below 2.
    """

    def __init__(self, joints: int, window: int = 5, dt: float = 0.002) -> None:
        joints = whole_number("joint velocity filter, joints", joints)
        window = whole_number("joint velocity filter, window", window, least=2)
        step = finite_number("joint velocity filter, dt", dt, above=0.0)
        self.window, self.delay = window, 0.5 * (window - 1) * step
        self.gain = math.sqrt(12.0 / (window * (window**2 - 1))) / step
        self._times, self._positions = np.zeros(window), np.zeros((window, joints))
        self._count = np.zeros(1, dtype=np.int64)

    def reset(self) -> None:
        """Drop all readings."""
        self._count[0] = 0

    def update(self, time: float, positions: Array) -> Array:
        """Add a reading (n,) at a time [s]; return the velocities (n,), 0 at the first.

        A reading that is not later than the last one replaces it.

        Raises
        ------
        InvalidInputError
            Something is NaN, or not one number per joint.
        """
        what, joints = "joint velocity filter", self._positions.shape[1]
        reading = finite_array(f"{what}, positions", positions, (joints,))
        time = finite_number(f"{what}, time", time)
        rates = np.empty(len(reading))
        memory = doubles(self._times), doubles(self._positions), integers(self._count)
        arguments = time, doubles(reading), doubles(rates)
        lib.wbc_joint_rates(self.window, len(reading), *memory, *arguments)
        return rates
