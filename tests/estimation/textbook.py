"""The invariant filter as the paper writes it, in matrices: an oracle for the core's arithmetic."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import block_diag, expm

from wbc.estimation import FilterNoise
from wbc.rotations import exp_rotation, log_rotation
from wbc.spatial import skew
from wbc.validate import Array

G = np.array((0.0, 0.0, -9.81))


@dataclass
class Textbook:
    """State and covariance; feet (position, rotation) that are all held."""

    R: Array
    v: Array
    p: Array
    feet: list[tuple[Array, Array]]
    noise: FilterNoise
    bg: Array = field(default_factory=lambda: np.zeros(3))
    ba: Array = field(default_factory=lambda: np.zeros(3))
    P: Array = field(default_factory=lambda: np.zeros((15, 15)))

    def dynamics(self, R: Array, v: Array, p: Array) -> Array:
        """A (n, n) of the invariant error; eq. (39) of the paper."""
        n = 15 + 6 * len(self.feet)
        A = np.zeros((n, n))
        A[0:3, 9:12] = -R
        A[3:6, 0:3], A[3:6, 9:12], A[3:6, 12:15] = skew(G), -skew(v) @ R, -R
        A[6:9, 3:6], A[6:9, 9:12] = np.eye(3), -skew(p) @ R
        for k, (d, _) in enumerate(self.feet):
            A[15 + 6 * k : 18 + 6 * k, 9:12] = -skew(d) @ R
        return A

    def predict(self, rate: Array, force: Array, dt: float) -> None:
        """By fine steps; the covariance by the matrix exponential in the middle."""
        w, a = rate - self.bg, force - self.ba
        n, h = 400, dt / 400
        half, step = exp_rotation(0.5 * h * w), exp_rotation(h * w)
        R, v, p = self.R, self.v, self.p
        for i in range(n):
            if i == n // 2:
                middle = R, v, p
            acceleration = R @ half @ a + G
            p = p + h * v + 0.5 * h * h * acceleration
            v, R = v + h * acceleration, R @ step
        size = 15 + 6 * len(self.feet)
        gain = np.zeros((size, 3))
        gain[0:3], gain[3:6], gain[6:9] = np.eye(3), skew(self.v), skew(self.p)
        for k, (d, _) in enumerate(self.feet):
            gain[15 + 6 * k : 18 + 6 * k] = skew(d)
        s, one = self.noise, np.eye(3)
        Q = s.gyroscope**2 * dt * gain @ gain.T
        va = s.accelerometer**2 * np.array(((dt, dt * dt / 2), (dt * dt / 2, dt**3 / 3)))
        Q[3:9, 3:9] += np.kron(va, one)
        walks = s.gyroscope_walk**2 * dt * one, s.accelerometer_walk**2 * dt * one
        foot = block_diag(s.creep**2 * dt * one, s.roll**2 * dt * one)
        Q += block_diag(np.zeros((9, 9)), *walks, *[foot] * len(self.feet))
        Phi = expm(self.dynamics(*middle) * dt)
        self.P = Phi @ self.P @ Phi.T + Q
        self.R, self.v, self.p = R, v, p

    def correct(self, k: int, place: Array, N: Array) -> float:
        """Return the normalised innovation squared."""
        d, own = self.feet[k]
        seen = self.R @ place[3:].reshape(3, 3)
        r = np.concatenate((self.p + self.R @ place[:3] - d, log_rotation(seen @ own.T)))
        H = np.zeros((6, len(self.P)))
        at = 15 + 6 * k
        H[0:3, 6:9], H[0:3, at : at + 3] = np.eye(3), -np.eye(3)
        H[3:6, 0:3], H[3:6, at + 3 : at + 6] = np.eye(3), -np.eye(3)
        turn = block_diag(self.R, self.R)
        S = H @ self.P @ H.T + turn @ N @ turn.T
        K = self.P @ H.T @ np.linalg.inv(S)
        self.P = (np.eye(len(self.P)) - K @ H) @ self.P
        self.move(-K @ r)
        return float(r @ np.linalg.solve(S, r))

    def move(self, e: Array) -> None:
        """X <- exp(e) X, on SE_{2+k}(3) by the matrix exponential."""
        count = 2 + len(self.feet)
        xi = np.zeros((3 + count, 3 + count))
        xi[:3, :3] = skew(e[:3])
        vectors = [self.v, self.p, *(d for d, _ in self.feet)]
        parts = [e[3:6], e[6:9], *(e[15 + 6 * k : 18 + 6 * k] for k in range(len(self.feet)))]
        xi[:3, 3:] = np.array(parts).T
        X = np.eye(3 + count)
        X[:3, :3], X[:3, 3:] = self.R, np.array(vectors).T
        X = expm(xi) @ X
        self.R, self.v, self.p = X[:3, :3], X[:3, 3], X[:3, 4]
        turns = [exp_rotation(e[18 + 6 * k : 21 + 6 * k]) for k in range(len(self.feet))]
        self.feet = [
            (X[:3, 5 + k], turn @ own)
            for k, (turn, (_, own)) in enumerate(zip(turns, self.feet, strict=True))
        ]
        self.bg, self.ba = self.bg + e[9:12], self.ba + e[12:15]
