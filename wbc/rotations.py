"""Rotations: as vectors (logarithm, its Jacobian and that Jacobian's rate), and checked."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pinocchio as pin

from wbc.errors import InvalidInputError
from wbc.validate import Array

# The rotation vector (3,) [rad] of a rotation matrix, of norm at most pi; every tick takes some.
log_rotation: Callable[[Array], Array] = pin.log3


def exp_rotation(w: Array) -> Array:
    """Return the rotation matrix (3, 3) of a rotation vector [rad]."""
    return pin.exp3(w)


def log_jacobian(R: Array) -> Array:
    """Return J (3, 3) with d(log R)/dt = J w, w the angular velocity of R in its own axes."""
    return pin.Jlog3(R)


def log_jacobian_rate(r: Array, rate: Array, w: Array) -> Array:
    """Return dJ/dt w (3,) of :func:`log_jacobian`, at the rotation vector ``r`` moving at ``rate``.

    J = 1 + [r]/2 + c(t) [r]^2 with t = |r| and c = 1/t^2 - (1 + cos t) / (2 t sin t), and
    [r]^2 w = r (r'w) - w t^2.
    """
    # Plain numbers: a third of the time of arrays this small.
    (rx, ry, rz), (dx, dy, dz), (wx, wy, wz) = r.tolist(), rate.tolist(), w.tolist()
    t = math.hypot(rx, ry, rz)
    c, slope = _second_order_coefficient(t)
    along = rx * dx + ry * dy + rz * dz
    growth = slope * along / t if t > 0.0 else 0.0
    on_r, on_rate = rx * wx + ry * wy + rz * wz, dx * wx + dy * wy + dz * wz
    a, b, d = growth * on_r + c * on_rate, c * on_r, growth * t * t + 2.0 * c * along
    return np.array(
        (
            0.5 * (dy * wz - dz * wy) + a * rx + b * dx - d * wx,
            0.5 * (dz * wx - dx * wz) + a * ry + b * dy - d * wy,
            0.5 * (dx * wy - dy * wx) + a * rz + b * dz - d * wz,
        )
    )


def _second_order_coefficient(t: float) -> tuple[float, float]:
    """Return c(t) and dc/dt; the series below 0.1 rad avoids the cancellation (error < 1e-14)."""
    if t < 0.1:
        t2 = t * t
        c = 1 / 12 + t2 * (1 / 720 + t2 * (1 / 30240 + t2 / 1209600))
        return c, t * (1 / 360 + t2 * (1 / 7560 + t2 / 201600))
    half = 0.5 * t
    cot = 1.0 / math.tan(half)  # (1 + cos t) / sin t
    c = 1 / t**2 - cot / (2 * t)
    return c, -2 / t**3 + cot / (2 * t**2) + (1 + cot * cot) / (4 * t)


def rotation_from(quaternion_xyzw: Array) -> Array:
    """Return the rotation matrix of a unit quaternion in (x, y, z, w) order."""
    return np.array(pin.Quaternion(quaternion_xyzw).toRotationMatrix())


def quaternion_from(R: Array) -> Array:
    """Return a unit quaternion (4,) of a rotation matrix, in (x, y, z, w) order."""
    return np.array(pin.Quaternion(R).coeffs())


def rotations_from(quaternion: Array) -> Array:
    """Return the rotation matrices (n, 3, 3) of unit quaternions (n, 4), x y z w."""
    x, y, z, w = quaternion.T
    return np.array(
        (
            (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
            (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
            (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
        )
    ).transpose(2, 0, 1)


def upright_on(normal: Array) -> Array:
    """Return the shortest rotation (3, 3) that takes the vertical to a unit normal."""
    x, y, z = normal.tolist()
    a = 1.0 / (1.0 + z)
    return np.array(
        ((1.0 - a * x * x, -a * x * y, x), (-a * x * y, 1.0 - a * y * y, y), (-x, -y, z))
    )


def check_rotation(what: str, R: Array) -> None:
    """Raise InvalidInputError unless R is a proper rotation to 1e-6."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()  # a tenth of the time that NumPy takes for this
    least, most = -1e-6, 1e-6
    if not (  # two columns orthonormal, the third their cross product
        least <= a * a + d * d + g * g - 1.0 <= most
        and least <= b * b + e * e + h * h - 1.0 <= most
        and least <= a * b + d * e + g * h <= most
        and least <= d * h - g * e - c <= most
        and least <= g * b - a * h - f <= most
        and least <= a * e - d * b - i <= most
    ):
        raise InvalidInputError(f"{what}: not a rotation matrix (R'R must be 1 and det R = +1)")


def headings(R: Array) -> Array:
    """Return the turn about the vertical (n,) [rad] that is nearest to rotations (n, 3, 3).

    It does not jump by more than pi. That of the x axis does where a foot points up or down.
    """
    return np.unwrap(np.arctan2(R[:, 1, 0] - R[:, 0, 1], R[:, 0, 0] + R[:, 1, 1]))


def same_sign(quaternions: Array) -> Array:
    """Return quaternions (n, 4), each with the sign nearest to the one before."""
    flips = (quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0.0
    signs = np.concatenate(([1.0], np.cumprod(np.where(flips, -1.0, 1.0))))
    return np.asarray(quaternions * signs[:, None])


def conjugate_product(p: Array, r: Array) -> Array:
    """Return the vector part (n, 3) of p* r, p conjugated, of quaternions (n, 4) xyzw."""
    a, b = p[:, :3], r[:, :3]
    return p[:, 3:] * b - r[:, 3:] * a - np.cross(a, b)
