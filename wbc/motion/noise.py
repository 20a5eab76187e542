"""The noise of a recording, estimated from the recording itself.

Taken to be white: independent from row to row, of one standard deviation per channel. What it does
to the pendulum is in :mod:`wbc.motion.uncertainty`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.stats import chi2

from wbc.errors import InvalidInputError
from wbc.motion.filtering import edge_rows, low_passed
from wbc.robot import Robot
from wbc.robot.limits import BASE_NQ
from wbc.robot.series import turning_joints
from wbc.rotations import conjugate_product
from wbc.validate import Array, finite_array, read_only, set_fields

# Differences of this order leave 1e-5 of a swing of 5 Hz sampled at 200 Hz, and of white noise all.
ORDER = 6
WINDOW = 64  # rows: the median over windows of so many passes over a landing or a frozen row
# A residual so many times what white noise leaves there tells that the noise is not white.
COLOURED = 1.5
ROUNDING = 1e-9  # rad or m: less is not noise but rounding
LEAST_PERIODS = 8.0  # of twice the cutoff, without which its residual is mostly ends


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
    # True if it is larger near the cutoff than at high frequencies: the recording was smoothed
    # before, or its noise is not white. The figures are then those near the cutoff.
    coloured: bool = False

    def __post_init__(self) -> None:
        sizes = {"joints": len(self.joints), "position": 3, "rotation": 3}
        for name, size in sizes.items():
            values = read_only(finite_array(f"noise: {name}", getattr(self, name), (size,)))
            if (values < 0.0).any():
                raise InvalidInputError(f"noise: {name}: standard deviations are not negative")
            set_fields(self, **{name: values})

    def typical(self, robot: Robot) -> dict[str, tuple[float, str]]:
        """Return the medians of the channels that have noise, each with its unit, by kind."""
        turn = turning_joints(robot)
        kinds = {
            "joints": (self.joints[turn], "rad"),
            "sliding joints": (self.joints[~turn], "m"),
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
        """(nv, k): errors that do not change over time.

        Of the base along world axes [m], about its own axes [rad], of joints [rad or m].
        """
        ...

    @property
    def late(self) -> float:
        """By how much all times may be wrong together, one standard deviation [s]."""
        ...

    def recorded(self) -> Noise:
        """Return the standard deviations of the channels, unfiltered."""
        ...

    def filtered(self, cutoff: float | None) -> tuple[Array, Array]:
        """Return what is left after the low-pass [Hz]: a covariance (3, 3), and a root (nv, k).

        The root times k independent errors gives those of the posture's tangent; the covariance is
        that of value, velocity and acceleration of one of these.
        """
        ...


def estimated_noise(rows: Array, rate: float, cutoff: float | None) -> Noise:
    """Return the noise of a recording's rows (n, nv+1): base position, quaternion xyzw, joints.

    From the sixth differences of each channel, which a smooth motion hardly has; if the residual
    above twice the cutoff is clearly larger than such noise would leave, from that residual.

    Parameters
    ----------
    rows:
        Evenly sampled but for jitter, without turns of 2 pi, not filtered. What was not recorded
        is constant, and has no noise.
    rate, cutoff:
        Of the rows and of the low-pass that they will have [Hz].
    """
    found = difference_noise(rows)
    found = np.where(found < ROUNDING, 0.0, found)
    coloured = np.zeros(len(found), dtype=bool)
    band = None if cutoff is None else min(2.0 * cutoff, 0.4 * rate)
    if band is not None and len(rows) > LEAST_PERIODS * rate / band:
        rest = in_tangent(rows, rows - low_passed(rows, rate, band))
        impulse = _unit(2 * edge_rows(len(rows), rate, band) + 1)
        near = _deviation(rest, impulse - low_passed(impulse[:, None], rate, band)[:, 0])
        coloured = (near > COLOURED * found) & (near > ROUNDING)
        found = np.where(coloured, near, found)
    return Noise(found[6:], found[:3], found[3:6], bool(coloured.any()))


def difference_noise(rows: Array) -> Array:
    """Return the standard deviations (nv,) of white noise in rows, by their sixth differences."""
    half = ORDER // 2
    changes = in_tangent(rows[half:-half], np.diff(rows, ORDER, axis=0))
    return _deviation(changes, np.diff(_unit(2 * ORDER + 1), ORDER))


def in_tangent(rows: Array, changes: Array) -> Array:
    """Return changes (n, nv) of rows (n, nv+1): of quaternions the rotation about body axes."""
    turned = 2.0 * conjugate_product(rows[:, 3:BASE_NQ], changes[:, 3:BASE_NQ])
    return np.hstack((changes[:, :3], turned, changes[:, BASE_NQ:]))


def _unit(count: int) -> Array:
    """Return an impulse in the middle of ``count`` rows."""
    return np.eye(1, count, count // 2)[0]


def _deviation(filtered: Array, impulse: Array) -> Array:
    """Return the standard deviations (k,) of white noise, given it filtered (n, k).

    Of a filter with this impulse response. The median of windows' mean squares, which are chi^2
    with as many degrees of freedom as its values are worth independent ones, sets it.
    """
    correlation = np.correlate(impulse, impulse, "full")
    energy = float(impulse @ impulse)
    windows = np.array_split(filtered**2, max(1, len(filtered) // WINDOW))
    squares = np.median([window.mean(axis=0) for window in windows], axis=0)
    if len(windows) > 2:
        freedom = len(filtered) / len(windows) * energy**2 / float(correlation @ correlation)
        squares = squares * freedom / chi2.median(freedom)
    return np.sqrt(squares / energy)
