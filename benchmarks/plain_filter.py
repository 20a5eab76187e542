"""A plain error-state Kalman filter of the same IMU and feet, for comparison.

Errors are differences of vectors, and rotations by small angles in the body's own axes, as in
Bloesch et al., *State estimation for legged robots* (2013), with flat feet. Its Jacobians depend on
the estimated state.
"""

from __future__ import annotations

import numpy as np

from wbc.estimation import FilterNoise
from wbc.rotations import exp_rotation, log_rotation
from wbc.spatial import skew
from wbc.validate import Array

G = np.array((0.0, 0.0, -9.81))


class PlainFilter:
    """State: rotation, velocity, position, biases, then of each foot position and rotation."""

    def __init__(self, noise: FilterNoise, R: Array, v: Array, p: Array, covariance: Array) -> None:
        self.noise, self.R, self.v, self.p = noise, R, v, p
        self.bg, self.ba = np.zeros(3), np.zeros(3)
        self.feet: list[tuple[Array, Array]] = []
        turned = np.eye(15)  # from turns in the world's axes to those in the body's
        turned[:3, :3] = R.T
        self.P = turned @ covariance @ turned.T

    def hold(self, place: Array, noise: Array) -> None:
        """Add a foot at its measured place."""
        turn = place[3:].reshape(3, 3)
        self.feet.append((self.p + self.R @ place[:3], self.R @ turn))
        n = len(self.P)
        by = np.zeros((6, n))
        by[:3, :3], by[:3, 6:9] = -self.R @ skew(place[:3]), np.eye(3)
        by[3:, :3] = turn.T
        seen = np.zeros((6, 6))
        seen[:3, :3], seen[3:, 3:] = self.R, turn.T
        P = np.zeros((n + 6, n + 6))
        P[:n, :n], P[n:, :n] = self.P, by @ self.P
        P[:n, n:] = P[n:, :n].T
        P[n:, n:] = by @ self.P @ by.T + seen @ noise @ seen.T
        self.P = P

    def predict(self, rate: Array, force: Array, dt: float) -> None:
        """Move on."""
        w, a, R, s = rate - self.bg, force - self.ba, self.R, self.noise
        n = len(self.P)
        A = np.zeros((n, n))
        A[:3, :3], A[:3, 9:12] = -skew(w), -np.eye(3)
        A[3:6, :3], A[3:6, 12:15] = -R @ skew(a), -R
        A[6:9, 3:6] = np.eye(3)
        Phi = np.eye(n) + dt * A + 0.5 * dt * dt * A @ A
        densities = (s.gyroscope, s.accelerometer, 0.0, s.gyroscope_walk, s.accelerometer_walk)
        feet = (s.creep, s.roll) * len(self.feet)
        Q = np.diag(np.repeat((*densities, *feet), 3) ** 2 * dt)
        self.P = Phi @ self.P @ Phi.T + Q
        acceleration = R @ exp_rotation(0.5 * dt * w) @ a + G
        self.p = self.p + dt * self.v + 0.5 * dt * dt * acceleration
        self.v = self.v + dt * acceleration
        self.R = R @ exp_rotation(dt * w)

    def correct(self, k: int, place: Array, noise: Array) -> float:
        """Correct by a foot's measurement; return the normalised innovation squared."""
        d, own = self.feet[k]
        expected, turn = self.R.T @ (d - self.p), self.R.T @ own
        at, n = 15 + 6 * k, len(self.P)
        H = np.zeros((6, n))
        H[:3, :3], H[:3, 6:9], H[:3, at : at + 3] = skew(expected), -self.R.T, self.R.T
        H[3:, :3], H[3:, at + 3 : at + 6] = -np.eye(3), turn  # in the body's axes
        seen = log_rotation(place[3:].reshape(3, 3) @ turn.T)
        r = np.concatenate((place[:3] - expected, seen))
        S = H @ self.P @ H.T + noise
        K = np.linalg.solve(S, H @ self.P).T
        e = K @ r
        self.P = self.P - K @ H @ self.P
        self.P = 0.5 * (self.P + self.P.T)
        self.R = self.R @ exp_rotation(e[:3])
        self.v, self.p = self.v + e[3:6], self.p + e[6:9]
        self.bg, self.ba = self.bg + e[9:12], self.ba + e[12:15]
        self.feet = [
            (foot + e[15 + 6 * j : 18 + 6 * j], turned @ exp_rotation(e[18 + 6 * j : 21 + 6 * j]))
            for j, (foot, turned) in enumerate(self.feet)
        ]
        return float(r @ np.linalg.solve(S, r))
