"""Directions and rotations of the solid pendulum; most work on numbers and on CasADi symbols."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from wbc.validate import Array

# Below this sine of half the angle, squared, a series of two terms is exact to rounding.
_SMALL = 1e-7


def leg_direction(theta: ca.SX, phi: ca.SX) -> ca.SX:
    """Return the unit vector n (3,) from the CoP to the CoM.

    theta turns it from the x axis to the z axis, phi out of that plane toward y. Its singular
    directions are +-y: there theta is undefined.
    """
    return ca.vertcat(ca.cos(theta) * ca.cos(phi), ca.sin(phi), ca.sin(theta) * ca.cos(phi))


def leg_axes(theta: float, phi: float) -> Array:
    """Return the leg's angular velocities (3, 2), world axes, per unit of theta' and of phi'.

    They are n x dn/dtheta and n x dn/dphi: the leg does not spin about itself.
    """
    ct, st, cp, sp = np.cos(theta), np.sin(theta), np.cos(phi), np.sin(phi)
    n = np.array((ct * cp, sp, st * cp))
    by_theta = np.array((-st * cp, 0.0, ct * cp))
    by_phi = np.array((-ct * sp, cp, -st * sp))
    return np.column_stack((np.cross(n, by_theta), np.cross(n, by_phi)))


def rotation_rows(x: Any, y: Any, z: Any, s: Any) -> tuple[tuple[Any, Any, Any], ...]:
    """Return the rows of the rotation matrix of the unit quaternion x, y, z, scalar part s."""
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * s), 2 * (x * z + y * s)),
        (2 * (x * y + z * s), 1 - 2 * (x * x + z * z), 2 * (y * z - x * s)),
        (2 * (x * z - y * s), 2 * (y * z + x * s), 1 - 2 * (x * x + y * y)),
    )


def quaternion_product(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return the quaternion (4,) of rotation a after rotation b, both x y z w."""
    vector = a[3] * b[:3] + b[3] * a[:3] + ca.cross(a[:3], b[:3])
    return ca.vertcat(vector, a[3] * b[3] - ca.dot(a[:3], b[:3]))


def turn(axis: int, angle: ca.SX) -> ca.SX:
    """Return the rotation matrix about axis 1, 2 or 3; a negative axis turns the other way."""
    c, s = ca.cos(angle), ca.sin(angle) * (1 if axis > 0 else -1)
    i, j = {1: (1, 2), 2: (2, 0), 3: (0, 1)}[abs(axis)]
    R = ca.SX.eye(3)
    R[i, i], R[j, j], R[i, j], R[j, i] = c, c, -s, s
    return R


def rotation_vector(quaternion: ca.SX) -> ca.SX:
    """Return the rotation vector (3,) [rad] of a unit quaternion x y z w, by the shorter way.

    The wheel's angle of a solid pendulum, as :class:`~wbc.rmp.balance.law.Bounds` limits it.
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
