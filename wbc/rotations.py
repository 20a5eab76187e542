"""Rotations: as vectors, as quaternions, and checked."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from wbc.errors import InvalidInputError
from wbc.native import lib, pointer
from wbc.validate import Array

# The rotation vector (3,) [rad] of a rotation matrix, of norm at most pi; every tick takes some.
log_rotation: Callable[[Array], Array] = pin.log3


def exp_rotation(w: Array) -> Array:
    """Return the rotation matrix (3, 3) of a rotation vector [rad]."""
    return pin.exp3(w)


def rotation_vectors(R: Array) -> Array:
    """Return the rotation vectors (n, 3) [rad] of rotations (n, 3, 3), of norm at most pi."""
    out = np.empty((len(R), 3))
    lib.wbc_logarithms(len(R), pointer(np.ascontiguousarray(R)), pointer(out))
    return out


def rotation_from(quaternion_xyzw: Array) -> Array:
    """Return the rotation matrix of a unit quaternion in (x, y, z, w) order."""
    return np.array(pin.Quaternion(quaternion_xyzw).toRotationMatrix())


def quaternion_from(R: Array) -> Array:
    """Return a unit quaternion (4,) of a rotation matrix, in (x, y, z, w) order."""
    return np.array(pin.Quaternion(R).coeffs())


def rotations_from(quaternion: Array) -> Array:
    """Return the rotation matrices (n, 3, 3) of unit quaternions (n, 4), x y z w."""
    x, y, z, s = quaternion.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * s), 2 * (x * z + y * s)),
        (2 * (x * y + z * s), 1 - 2 * (x * x + z * z), 2 * (y * z - x * s)),
        (2 * (x * z - y * s), 2 * (y * z + x * s), 1 - 2 * (x * x + y * y)),
    )
    return np.array(rows).transpose(2, 0, 1)


def upright_on(normal: Array) -> Array:
    """Return the shortest rotation (3, 3) that takes the vertical to a unit normal."""
    x, y, z = normal.tolist()
    a = 1.0 / (1.0 + z)
    return np.array(
        ((1.0 - a * x * x, -a * x * y, x), (-a * x * y, 1.0 - a * y * y, y), (-x, -y, z))
    )


def check_rotation(what: object, R: Array, which: str = "") -> None:
    """Raise InvalidInputError, with ``which`` of ``what``, unless R is a rotation to 1e-6."""
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
        what = f"{what}, {which}" if which else what
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
