"""Errors of an estimate, by a simulation's true state."""

from __future__ import annotations

import math

import numpy as np

from wbc.estimation import Estimate
from wbc.rotations import log_rotation, rotation_from
from wbc.validate import Array


class EstimateErrors:
    """Errors of the base's estimates over a run, and their consistency with the covariances.

    Attributes
    ----------
    count:
        Number of estimates.
    way:
        Horizontal distance that the base travelled [m], from its places every quarter of a second,
        so that its sway hardly counts.
    drift, yaw:
        Horizontal error of the position [m] and of the heading [rad] at the last estimate.
    rise:
        Error of the base's height at the last estimate [m].
    """

    def __init__(self) -> None:
        self.count = 0
        self.way = self.drift = self.yaw = self.rise = 0.0
        self._squares = np.zeros(5)  # velocity, tilt; normalised: velocity, tilt, and innovation
        self._rows = 0
        self._last_place: tuple[float, Array] | None = None

    def add(self, estimate: Estimate, q: Array, v: Array) -> None:
        """Compare an estimate with the configuration (nq,) and velocity (nv,) of its time."""
        R, estimated = rotation_from(q[3:7]), rotation_from(estimate.q[3:7])
        rotation, P = log_rotation(estimated @ R.T), estimate.covariance
        velocity = estimated @ estimate.v[:3] - R @ v[:3]
        squares = (
            velocity @ velocity,
            rotation[:2] @ rotation[:2],
            velocity @ np.linalg.solve(P[3:6, 3:6], velocity) / 3.0,
            rotation[:2] @ np.linalg.solve(P[:2, :2], rotation[:2]) / 2.0,
            estimate.innovation[0],
        )
        self._squares += np.array(squares, dtype=float)
        self._rows += estimate.innovation[1]
        self.count += 1
        self.drift = math.hypot(*(estimate.q[:2] - q[:2]).tolist())
        self.yaw, self.rise = float(rotation[2]), float(estimate.q[2] - q[2])
        if self._last_place is None or estimate.time - self._last_place[0] >= 0.25:
            if self._last_place is not None:
                self.way += math.hypot(*(q[:2] - self._last_place[1]).tolist())
            self._last_place = estimate.time, q[:2].copy()

    @property
    def velocity(self) -> float:
        """Root mean square error of the linear velocity, its norm [m/s]."""
        return math.sqrt(float(self._squares[0]) / max(self.count, 1))

    @property
    def tilt(self) -> float:
        """Root mean square error of the tilt [rad]."""
        return math.sqrt(float(self._squares[1]) / max(self.count, 1))

    @property
    def normalised(self) -> tuple[float, float]:
        """Mean normalised squares of velocity and tilt per degree of freedom: 1 if consistent.

        Errors of the base, by the covariance of the IMU: it is to be on the base.
        """
        v, tilt = (self._squares[2:4] / max(self.count, 1)).tolist()
        return v, tilt

    @property
    def innovation(self) -> float:
        """Mean normalised innovation squared per row: 1 if the noise is as modelled."""
        return float(self._squares[4]) / max(self._rows, 1)

    def __str__(self) -> str:
        share = f" ({100.0 * self.drift / self.way:.1f} % of the way)" if self.way > 1.0 else ""
        return (
            f"estimated state: velocity off by {self.velocity:.3f} m/s (rms), tilt by"
            f" {math.degrees(self.tilt):.2f} degrees; in the end heading by"
            f" {math.degrees(self.yaw):.1f} degrees, position by {1e3 * self.drift:.0f} mm{share},"
            f" height by {1e3 * self.rise:+.0f} mm"
        )
