"""An estimated state with its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class Estimate:
    """A state with its uncertainty, at the time of the last measurement.

    Errors are estimate minus truth, in world axes. Heading (yaw) and position are unobservable by
    IMU, joints and feet: they are relative to the start, and their variance only grows.

    Attributes
    ----------
    time:
        Of the measurement [s].
    q:
        Configuration (nq,): base position [m], quaternion x y z w, joints.
    v:
        Velocity (nv,): base linear and angular in base axes, joints' rates.
    covariance:
        (15, 15) of the primary IMU's rotation [rad], velocity [m/s], position [m], gyroscope bias
        [rad/s] and accelerometer bias [m/s^2]; the biases in its own axes.
    contacts:
        Feet in contact, which are assumed to stand still.
    slipping:
        Feet that bear, but move; they are not used.
    gyroscope_bias, accelerometer_bias:
        (3,) [rad/s], [m/s^2] of the primary IMU, in its axes.
    forces:
        Wrench (6,) on the sole by foot, at its frame's origin in world axes [N, N m], by momentum
        residuals; empty without torques.
    innovation:
        Normalised innovation squared of this update, and its degrees of freedom.
    notes:
        What was rejected, skipped or guessed in this update.
    """

    time: float
    q: Array
    v: Array
    covariance: Array
    contacts: tuple[str, ...]
    slipping: tuple[str, ...]
    gyroscope_bias: Array
    accelerometer_bias: Array
    forces: Mapping[str, Array]
    innovation: tuple[float, int]
    notes: tuple[str, ...]

    @property
    def tilt_deviation(self) -> float:
        """Standard deviation of the tilt from the vertical, both axes together [rad]."""
        return math.sqrt(float(self.covariance[0, 0] + self.covariance[1, 1]))

    @property
    def yaw_deviation(self) -> float:
        """Standard deviation of the heading [rad], relative to that at the start: it grows."""
        return math.sqrt(float(self.covariance[2, 2]))

    @property
    def velocity_deviation(self) -> float:
        """Standard deviation of the linear velocity, all axes together [m/s]."""
        return math.sqrt(float(np.trace(self.covariance[3:6, 3:6])))

    @property
    def position_deviation(self) -> float:
        """Standard deviation of the position [m], relative to that at the start: it grows."""
        return math.sqrt(float(np.trace(self.covariance[6:9, 6:9])))
