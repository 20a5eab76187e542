"""Principal axes tracked over time: in one order and with one sign, also where eigenvalues cross.

An eigen-decomposition determines axes only up to order and sign: 24 right-handed triads. Here each
frame takes the triad nearest to the frame before. Where two second moments are closer than a
tolerance, the axes in their plane are undefined: they are carried along with the least rotation and
reported as undefined, so that later axes keep their identity.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.rmp.ellipsoid import ROUNDING, equimomental
from wbc.rotations import check_rotation
from wbc.validate import Array, Bools, finite_array, finite_number, finite_vector, read_only

# Two second moments closer than this fraction of the largest count as equal: an inertia accurate to
# one part in a million then has axes accurate to a milliradian.
GAP = 1e-3
SAME_AXIS = 1e-6  # two unit vectors are one axis if their cosine squared is this near to one
_NEXT, _AFTER = np.array([1, 2, 0]), np.array([2, 0, 1])  # (i, j, k) cyclic


@dataclass(frozen=True, eq=False)
class TrackedAxes:
    """Principal axes e_k of n inertias in a row; reaction masses are at r_k = sqrt(3 lambda_k / M).

    An axis is undefined if it was carried along because second moments were too close.
    """

    second_moments: Array  # lambda_k of mass along each axis (n, 3) [kg m^2]
    axes: Array  # e_k as the columns of rotations (n, 3, 3)
    defined: Bools  # (n, 3)

    def __post_init__(self) -> None:
        read_only(self.second_moments)
        read_only(self.axes)
        self.defined.flags.writeable = False


def track(
    inertias: ArrayLike, *, previous: ArrayLike | None = None, gap: float = GAP
) -> TrackedAxes:
    """Return the principal axes of a series of inertias, without flips.

    The axes must turn by less than 45 degrees between frames; beyond that a rotation cannot be
    distinguished from a change of order or sign. Memory: some 500 bytes per frame.

    ``inertias``: moments of inertia about the CoM (n, 3, 3) [kg m^2].
    ``previous``: axes (3, 3) of the frame before the first. By default the first frame's axes are
    those of :func:`~wbc.rmp.ellipsoid.equimomental`, the longest first.
    ``gap``: axes whose second moments are closer than this fraction of the largest are undefined.

    Raises InvalidInputError: wrong shape, not finite, not symmetric, or an inertia that no body can
    have (the message names the frame); ``previous`` not a rotation, or a ``gap`` that is not
    positive.
    """
    I = _checked(inertias)  # noqa: E741
    gap = finite_number("gap", gap, above=0.0)
    moments, raw = np.linalg.eigh(I)
    along = np.maximum(0.5 * moments.sum(axis=1)[:, None] - moments, 0.0)  # descending
    raw *= np.sign(np.linalg.det(raw))[:, None, None]
    defined = are_distinct(along, gap)
    start = equimomental(I[0], 1.0).axes if previous is None else checked_rotation(previous)
    axes = np.empty_like(raw)
    for k in range(len(raw)):
        axes[k] = start = _follow_frame(raw[k], defined[k], start)
    # Rayleigh quotients: the eigenvalues where axes are defined, and close to them elsewhere.
    about = np.einsum("nik,nij,njk->nk", axes, I, axes)
    second = np.maximum(0.5 * about.sum(axis=1)[:, None] - about, 0.0)
    mapped = (np.swapaxes(axes, 1, 2) @ raw) ** 2  # (n, tracked, raw), rows sum to 1
    kept = np.einsum("nij,nj->ni", mapped, defined.astype(float)) > 1.0 - SAME_AXIS
    return TrackedAxes(second, axes, kept)


def follow(axes: ArrayLike, second_moments: ArrayLike, previous: ArrayLike, gap: float) -> Array:
    """Return principal axes (3, 3) as nearest to those of the frame before, ``previous`` (3, 3).

    The second moments (3,) are those along ``axes``, the largest first; for ``gap`` see
    :func:`track`.

    Raises InvalidInputError: axes that are not a rotation.
    """
    raw, before = checked_rotation(axes), checked_rotation(previous)
    moments = finite_vector("second moments", second_moments, 3)
    return _follow_frame(raw, are_distinct(moments, finite_number("gap", gap, above=0.0)), before)


def are_distinct(second_moments: Array, gap: float = GAP) -> Bools:
    """Return which axes are defined (..., 3), bool, given second moments (..., 3), largest first.

    An axis is undefined if its second moment is within ``gap`` times the largest of another's.
    """
    apart = -np.diff(second_moments, axis=-1) > gap * second_moments[..., :1]  # (..., 2)
    return np.stack((apart[..., 0], apart[..., 0] & apart[..., 1], apart[..., 1]), axis=-1)


def turning_rate(inertia: Array, inertia_rate: Array, axes: Array) -> Array:
    """Return the angular velocity (..., 3) [rad/s] of principal axes (..., 3, 3) of I, world axes.

    Geometry, not momentum: w_k = e_i' I' e_j / (I_i - I_j) along e_k, (i, j, k) cyclic, from I and
    dI/dt (..., 3, 3) [kg m^2, kg m^2/s]. All axes must be defined: the quotient is meaningless
    where two moments are equal.
    """
    turned = np.swapaxes(axes, -1, -2)
    moments = np.diagonal(turned @ inertia @ axes, axis1=-2, axis2=-1)
    rate = turned @ inertia_rate @ axes
    # Component i is about e_i and comes from the pair that follows it.
    speeds = rate[..., _NEXT, _AFTER] / (moments[..., _NEXT] - moments[..., _AFTER])
    return np.asarray((axes @ speeds[..., None])[..., 0])


def checked_rotation(value: ArrayLike) -> Array:
    """Return axes (3, 3) as a fresh array; InvalidInputError if they are not a rotation."""
    R = finite_array("axes", value, (3, 3))
    check_rotation("axes", R)
    return R


def _checked(inertias: ArrayLike) -> Array:
    """Return (n, 3, 3) inertias, symmetric to the last bit; see :func:`track` for the errors."""
    try:
        count = len(inertias)  # type: ignore[arg-type]
    except TypeError as error:
        raise InvalidInputError("inertias: expected an array (n, 3, 3)") from error
    if count == 0:
        raise InvalidInputError("inertias: expected at least one frame, got none")
    I = finite_array("inertias", inertias, (count, 3, 3))  # noqa: E741
    size = np.abs(I).max(axis=(1, 2))
    skewness = np.abs(I - np.swapaxes(I, 1, 2)).max(axis=(1, 2))
    moments = np.linalg.eigvalsh(I)
    excess = moments[:, 2] - moments[:, 0] - moments[:, 1]
    for what, amount in (
        ("is not symmetric: mirrored entries differ", skewness),
        ("is that of no body: its largest moment exceeds the sum of the others", excess),
    ):
        wrong = np.flatnonzero(amount > ROUNDING * size)
        if len(wrong):
            k = int(wrong[0])
            more = f", and {len(wrong) - 1} more" if len(wrong) > 1 else ""
            raise InvalidInputError(f"inertias[{k}]{more}: {what} by {amount[k]:.3g} kg m^2")
    return 0.5 * (I + np.swapaxes(I, 1, 2))


# ------------------------------------------------------------------ the 24 ways


_SIGNED = (
    np.eye(3)[:, order] * signs
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3))
)
_TRIADS = read_only(np.array([way for way in _SIGNED if np.linalg.det(way) > 0.0]))


def _follow_frame(raw: Array, defined: Bools, before: Array) -> Array:
    """Return one frame's axes (3, 3) nearest to ``before``, free to turn in undefined planes."""
    if defined.all():  # the triad C for which raw @ C is nearest: the largest trace
        return raw @ _TRIADS[np.einsum("ij,cji->c", before.T @ raw, _TRIADS).argmax()]
    if not defined.any():
        return before.copy()
    # One axis is defined. Of all rotations that have it among their columns, the nearest comes
    # from ``before`` by the least turn that brings its nearest column there.
    axis = raw[:, int(np.flatnonzero(defined)[0])]
    cosines = before.T @ axis
    k = int(np.abs(cosines).argmax())
    i, j = int(_NEXT[k]), int(_AFTER[k])
    axis = np.copysign(1.0, cosines[k]) * axis
    beside = _least_rotation(before[:, k], axis) @ before[:, i]
    # Made square again: left alone, the rounding would double from frame to frame.
    beside -= (beside @ axis) * axis
    followed = np.empty((3, 3))
    followed[:, k] = axis
    followed[:, i] = beside / np.linalg.norm(beside)
    followed[:, j] = np.cross(axis, followed[:, i])
    return followed


def _least_rotation(a: Array, b: Array) -> Array:
    """Return the rotation (3, 3) about a x b that takes unit vector a to b, b not opposite."""
    both = a + b
    return np.eye(3) - np.outer(both, both) / (1.0 + a @ b) + 2.0 * np.outer(b, a)
