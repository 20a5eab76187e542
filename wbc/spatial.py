"""Small linear algebra of rotations and symmetric 3x3 matrices. Linear part first, everywhere.

The half-vectorisation of a symmetric matrix S is vech(S) = (xx, xy, xz, yy, yz, zz), the order of
the paper's eq. 24. Its plain 2-norm is not the Frobenius norm of S: off-diagonal entries count
twice in the latter, hence :data:`FROBENIUS_WEIGHTS`.
"""

from __future__ import annotations

import numpy as np

from wbc.validate import Array

STANDARD_GRAVITY = 9.81  # m/s^2, where no model says another
COMPONENTS = ("xx", "xy", "xz", "yy", "yz", "zz")
ROWS = np.array([0, 0, 0, 1, 1, 2])
COLUMNS = np.array([0, 1, 2, 1, 2, 2])
DIAGONAL = np.array([0, 3, 5])
FROBENIUS_WEIGHTS = np.array([1.0, 2.0, 2.0, 1.0, 2.0, 1.0])
_ENTRIES = 3 * ROWS + COLUMNS  # of the matrix, row by row
_MATRIX_INDEX = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])


def skew(w: Array) -> Array:
    """Return the (3, 3) cross-product matrix: ``skew(w) @ x == cross(w, x)``."""
    x, y, z = w.tolist()
    return np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))


def skews(vectors: Array) -> Array:
    """Return the cross-product matrices (n, 3, 3) of vectors (n, 3)."""
    x, y, z = vectors.T
    found = np.zeros((len(vectors), 3, 3))
    found[:, 0, 1], found[:, 0, 2], found[:, 1, 2] = -z, y, -x
    found[:, 1, 0], found[:, 2, 0], found[:, 2, 1] = z, -y, x
    return found


def twist_products(twists: Array) -> Array:
    """Return the matrices (n, 6, 6) of ``twist x`` another twist, of twists (n, 6)."""
    found = np.zeros((len(twists), 6, 6))
    found[:, :3, :3] = found[:, 3:, 3:] = skews(twists[:, 3:])
    found[:, :3, 3:] = skews(twists[:, :3])
    return found


def vech(S: Array) -> Array:
    """Return the (6,) vector (xx, xy, xz, yy, yz, zz) of a symmetric (3, 3) matrix."""
    return S.take(_ENTRIES)


def vech_inverse(s: Array) -> Array:
    """Return the symmetric (3, 3) matrix of a (6,) vector; inverse of :func:`vech`."""
    return s[_MATRIX_INDEX]


def congruence(R: Array) -> Array:
    """Return the (6, 6) matrix D with ``vech(R @ S @ R.T) == D @ vech(S)``, any (3, 3) R.

    Entry (ab, cd) is R_ac R_bd + R_ad R_bc, halved where c = d.
    """
    left, right = R[ROWS], R[COLUMNS]  # (6, 3) each
    D = left[:, ROWS] * right[:, COLUMNS]
    D += left[:, COLUMNS] * right[:, ROWS]
    D[:, DIAGONAL] *= 0.5
    return D


def commutator_matrix(S: Array) -> Array:
    """Return the (6, 3) matrix K(S) with ``K @ w == vech(skew(w) @ S - S @ skew(w))``.

    It is the rate of a symmetric tensor that is carried round at angular velocity w.
    """
    (a, b, c), (_, d, e), (_, _, f) = S.tolist()
    return np.array(
        (
            (0.0, 2 * c, -2 * b),
            (-c, e, a - d),
            (b, f - a, -e),
            (-2 * e, 0.0, 2 * b),
            (d - f, -b, c),
            (2 * e, -2 * c, 0.0),
        )
    )
