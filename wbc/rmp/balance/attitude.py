"""The angle of the solid pendulum's masses, as a law's symbols."""

from __future__ import annotations

import casadi as ca

from wbc.rmp.frames import quaternion_product, rotation_rows

# Below this sine of half the angle, squared, a series of two terms is exact to rounding.
_SMALL = 1e-7


def rotation_vector(quaternion: ca.SX) -> ca.SX:
    """Return the rotation vector (3,) [rad] of a unit quaternion x y z w, by the shorter way.

    The wheel's angle of a solid pendulum, as :class:`~wbc.rmp.balance.bounds.Bounds` limits it.
    """
    # One orientation, two quaternions: the one with the positive scalar part is the shorter way.
    q = ca.if_else(quaternion[3] < 0.0, -1.0, 1.0) * quaternion
    square = ca.sumsqr(q[:3])
    size = ca.sqrt(ca.fmax(square, _SMALL))
    # angle / sine of half of it; the series in the square of that sine has slopes at zero too.
    ratio = ca.if_else(square > _SMALL, 2.0 * ca.atan2(size, q[3]) / size, 2.0 + square / 3.0)
    return ratio * q[:3]


def rotation(quaternion: ca.SX) -> ca.SX:
    """Return the rotation matrix (3, 3) of a unit quaternion x y z w."""
    rows = rotation_rows(*(quaternion[k] for k in range(4)))
    return ca.vertcat(*(ca.horzcat(*row) for row in rows))


def quaternion_rate(quaternion: ca.SX, rate: ca.SX) -> ca.SX:
    """Return the rate (4,) of a unit quaternion that turns at the body rate (3,)."""
    return 0.5 * quaternion_product(quaternion, ca.vertcat(rate, 0.0))
