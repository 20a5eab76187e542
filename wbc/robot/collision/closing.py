"""How fast pairs of bodies close, and the distance that they need to stop."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.validate import Array


class Closing(NamedTuple):
    """How a pair that closes is braked.

    Attributes
    ----------
    dt:
        Time for which a speed is held before braking begins [s].
    deceleration:
        Of the distance [m/s^2].
    gain:
        Largest fraction of the clearance to use up in one tick.
    slowest:
        Time that the slowest joint takes to stop, max |v| / a [s]; 0 if joints brake without limit.
        A distance of Jacobian J closes at |J| |v| at most and is braked by |J| a: it takes no
        longer than that joint.
    """

    dt: float
    deceleration: float
    gain: float
    slowest: float = 0.0

    def way(self, speed: Array) -> Array:
        """Return the distances (k,) [m] that it takes to stop from ``speed`` (k,) [m/s].

        At least the inverse of the speed that a margin allows (:mod:`wbc.constraints.margin`).
        """
        speed = np.maximum(speed, 0.0)
        wait = self.dt + np.maximum(0.5 * speed / self.deceleration, self.slowest)
        way: Array = speed * np.maximum(wait, self.dt / self.gain)
        return way


class PairMotion:
    """How the second body of each pair moves against the first.

    Parameters
    ----------
    twists:
        (6, bodies) velocity at the world's origin [m/s] and spin [rad/s].
    pairs:
        (N, 2) bodies.
    """

    def __init__(self, twists: Array, pairs: NDArray[np.int64]) -> None:
        first, second = pairs.T
        self._twists = twists.take(second, axis=1)  # (6, N)
        self._twists -= twists.take(first, axis=1)

    def at(self, points: Array) -> Array:
        """Return the velocities (3, N) [m/s] at points (3, N) of the first bodies."""
        (x, y, z), (u, v, w) = points, self._twists[3:]
        moving = self._twists[:3].copy()
        moving += (v * z - w * y, w * x - u * z, u * y - v * x)
        return moving

    def most(self, middles: Array, reaches: Array) -> Array:
        """Return bounds (N,) [m/s] on the speed at which pairs close.

        Parameters
        ----------
        middles, reaches:
            (3, N), (N,): balls round the first bodies [m].
        """
        bounds = _lengths(self._twists[3:])
        bounds *= reaches
        bounds += _lengths(self.at(middles))
        return bounds

    def closing(self, normal: Array, point: Array) -> Array:
        """Return at which speed (N,) [m/s] distances shrink; negative: they grow.

        Parameters
        ----------
        normal, point:
            (N, 3): unit vectors from the second body to the first, and points on the first [m].
        """
        closing: Array = np.einsum("ik,ki->k", self.at(point.T), normal)
        return closing


def _lengths(a: Array) -> Array:
    return np.sqrt(np.einsum("ik,ik->k", a, a))
