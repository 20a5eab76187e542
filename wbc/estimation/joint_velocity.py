"""Joint velocities from encoders alone: a line fitted to the last readings, with a stated delay."""

from __future__ import annotations

import math

import numpy as np

from wbc.errors import InvalidInputError
from wbc.validate import Array, finite_number


class JointVelocityFilter:
    """The slope of the least-squares line through the last readings of each joint.

    Of all linear filters of so many readings that see a constant velocity as it is, this one has
    the least white noise. It sees an accelerating joint as it was :attr:`delay` ago.

    Parameters
    ----------
    window:
        Readings; 2 is a plain difference.
    dt:
        Usual time between them [s], for what is said here; the filter takes their real times.

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
        if not isinstance(window, int) or window < 2:
            raise InvalidInputError(f"joint velocity filter, window: at least 2, got {window!r}")
        step = finite_number("joint velocity filter, dt", dt, above=0.0)
        self.window, self.delay = window, 0.5 * (window - 1) * step
        self.gain = math.sqrt(12.0 / (window * (window**2 - 1))) / step
        self._times, self._positions = np.zeros(window), np.zeros((window, joints))
        self._count = 0

    def reset(self) -> None:
        """Forget all readings."""
        self._count = 0

    def update(self, time: float, positions: Array) -> Array:
        """Take in a reading (n,) at a time [s]; return the velocities (n,), 0 at the first.

        A time that is not later than the last one's takes the place of the last reading.
        """
        n = self.window
        if self._count and time <= self._times[-1]:
            self._positions[-1] = positions
        else:
            self._times[:-1], self._positions[:-1] = self._times[1:], self._positions[1:]
            self._times[-1], self._positions[-1] = time, positions
            self._count = min(self._count + 1, n)
        if self._count < 2:
            return np.zeros(len(positions))
        times = self._times[n - self._count :].tolist()  # few numbers: Python is quicker
        mean = sum(times) / self._count
        offsets = [time - mean for time in times]
        weight = 1.0 / sum(offset * offset for offset in offsets)
        weights = np.array([weight * offset for offset in offsets])
        return weights @ self._positions[n - self._count :]

    def memory(self) -> tuple[Array, Array, int]:
        """Return all that it knows, for :meth:`restore`."""
        return self._times.copy(), self._positions.copy(), self._count

    def restore(self, memory: tuple[Array, Array, int]) -> None:
        """Go back to what :meth:`memory` returned."""
        self._times[:], self._positions[:], self._count = memory
