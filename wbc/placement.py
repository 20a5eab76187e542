"""Rotations and placements as CasADi expressions."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import casadi as ca
import numpy as np

from wbc.validate import Array

EXACT_WITHIN = 1e-14  # entries this near to 0, 1 or -1 are made exact, which saves operations
# Below this 1 - cos(angle) the logarithm's factor is a series, above it closed; both are exact.
SERIES_BELOW = 0.05
_SERIES = [4.0**n * factorial(n) ** 2 / factorial(2 * n + 1) for n in range(12)]
HALF_TURN = 1e-9  # how near to half a turn, in 1 + cos(angle), the logarithm's factor grows


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a frame is: ``x_outside = rotation @ x + position``."""

    rotation: ca.SX  # (3, 3)
    position: ca.SX  # (3, 1) [m]

    @classmethod
    def constant(cls, rotation: Array, position: Array) -> Placement:
        """Return a placement of numbers; entries that are 0 but for rounding become 0."""
        return cls(constant(rotation), constant(position))

    def __matmul__(self, inner: Placement) -> Placement:
        """Return the placement of a frame that is at ``inner`` in this one."""
        R = ca.mtimes(self.rotation, inner.rotation)
        return Placement(R, self.position + ca.mtimes(self.rotation, inner.position))

    def inverse(self) -> Placement:
        """Return the placement of the outer frame as seen from this one."""
        R = self.rotation.T
        return Placement(R, -ca.mtimes(R, self.position))


def constant(values: Array) -> ca.SX:
    """Return numbers as a sparse SX, rounding errors of 0 and +-1 removed."""
    array = np.array(values, dtype=float)
    for exact in (0.0, 1.0, -1.0):
        array[np.abs(array - exact) < EXACT_WITHIN] = exact
    return ca.SX(ca.sparsify(ca.DM(array)))


def turn_about(axis: Array, cosine: ca.SX, sine: ca.SX) -> ca.SX:
    """Return the rotation (3, 3) about a unit ``axis`` (3,) (Rodrigues)."""
    along = np.outer(axis, axis)
    cross = np.cross(np.eye(3), axis)  # rows e_i x axis: the cross-product matrix of axis
    return constant(along) + cosine * constant(np.eye(3) - along) + sine * constant(cross)


def from_quaternion(quaternion: ca.SX) -> ca.SX:
    """Return the rotation (3, 3) of a unit quaternion (x, y, z, w)."""
    S = ca.skew(quaternion[:3])
    return ca.SX(ca.DM.eye(3)) + 2.0 * (quaternion[3] * S + ca.mtimes(S, S))


def from_mrp(sigma: ca.SX) -> ca.SX:
    """Return the rotation (3, 3) of modified Rodrigues parameters axis * tan(angle / 4).

    A rational function: smooth, unconstrained, and regular up to a full turn.
    """
    S, square = ca.skew(sigma), ca.sumsqr(sigma)
    turned = 8.0 * ca.mtimes(S, S) + 4.0 * (1.0 - square) * S
    return ca.SX(ca.DM.eye(3)) + turned / (1.0 + square) ** 2


def rotation_log(R: ca.SX) -> ca.SX:
    """Return the rotation vector (3, 1) [rad] of R, with derivatives of every order at 0.

    It is angle / sin(angle) times the antisymmetric part. That factor is a smooth function of
    u = 1 - cos(angle), though not of the angle's cosine as computers evaluate it: hence a series
    near u = 0. Each branch is kept away from where it is singular, because derivatives go through
    both. At half a turn itself the direction is not defined.
    """
    antisymmetric = 0.5 * ca.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1])
    u = 0.5 * (3.0 - ca.trace(R))
    series = ca.SX(0.0)
    for coefficient in reversed(_SERIES):
        series = coefficient + 0.5 * u * series
    far = ca.fmin(ca.fmax(u, SERIES_BELOW), 2.0 - HALF_TURN)
    closed = ca.acos(1.0 - far) / ca.sqrt(far * (2.0 - far))
    return ca.if_else(u < SERIES_BELOW, series, closed) * antisymmetric
