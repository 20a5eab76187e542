"""The quadratic program of one tick, and the check that it may be given to a solver."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.native import lib
from wbc.validate import Array, real_array

# Larger entries are refused: their squares overflow.
LARGEST: float = lib.wbc_largest_qp
ROUNDING = 1e-9  # of P's largest eigenvalue: the most that a sum of squares has below zero


@dataclass(frozen=True, slots=True)
class Labels:
    """Names of the rows and variables of a QP, made once per contact set and reused every tick.

    Parameters
    ----------
    equality:
        One name per row of A.
    inequality:
        One name per row of C.
    variables:
        One name per unknown; a bound is named after its variable.
    """

    equality: tuple[str, ...]
    inequality: tuple[str, ...]
    variables: tuple[str, ...]

    @classmethod
    def numbered(cls, n: int, me: int = 0, mi: int = 0) -> Labels:
        """Return the names ``equality 0``, ``inequality 0``, ``x0``, ... for an anonymous QP."""
        return cls(
            tuple(f"equality {i}" for i in range(me)),
            tuple(f"inequality {i}" for i in range(mi)),
            tuple(f"x{j}" for j in range(n)),
        )


class QP(NamedTuple):
    """Minimise 1/2 x'Px + g'x subject to A x = b, l <= C x <= u, lower <= x <= upper.

    Every field is a float array: no rows is a (0, n) array, no bound is an infinity. P is
    symmetric positive semidefinite: solvers read one triangle only, and a tick does not check it.
    """

    P: Array  # (n, n)
    g: Array  # (n,)
    A: Array  # (me, n)
    b: Array  # (me,)
    C: Array  # (mi, n)
    l: Array  # (mi,)  # noqa: E741
    u: Array  # (mi,)
    lower: Array  # (n,)
    upper: Array  # (n,)
    labels: Labels

    def __repr__(self) -> str:
        rows = f"{len(self.b)} equalities, {len(self.l)} inequalities"
        return f"QP({self.g.size} variables, {rows})"

    @classmethod
    def build(
        cls,
        P: ArrayLike,
        g: ArrayLike,
        *,
        A: ArrayLike | None = None,
        b: ArrayLike | None = None,
        C: ArrayLike | None = None,
        l: ArrayLike | None = None,  # noqa: E741
        u: ArrayLike | None = None,
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        labels: Labels | None = None,
    ) -> QP:
        """Return a checked QP with everything left out filled in: for use outside the tick.

        Raises
        ------
        InvalidInputError
            See :func:`check_qp`; or P is not symmetric, or not positive semidefinite.
        """
        g = real_array("QP.g", g)
        n = g.size
        A, C = _array("A", A, (0, n)), _array("C", C, (0, n))
        me, mi = len(np.atleast_1d(A)), len(np.atleast_1d(C))
        qp = cls(
            P=real_array("QP.P", P),
            g=g,
            A=A,
            b=_array("b", b, me),
            C=C,
            l=_array("l", l, mi, -np.inf),
            u=_array("u", u, mi, np.inf),
            lower=_array("lower", lower, n, -np.inf),
            upper=_array("upper", upper, n, np.inf),
            labels=labels or Labels.numbered(n, me, mi),
        )
        check_qp(qp)
        if not np.allclose(qp.P, qp.P.T, rtol=1e-9, atol=1e-13 * np.abs(qp.P).max()):
            raise InvalidInputError("QP.P: must be symmetric; use 1/2 (P + P')")
        curvatures = np.linalg.eigvalsh(qp.P)
        if curvatures[0] < -ROUNDING * abs(curvatures).max():
            raise InvalidInputError(
                f"QP.P: the cost falls without bound along some direction (eigenvalue"
                f" {curvatures[0]:.3g}); it must be positive semidefinite, check signs of weights"
            )
        return qp


def _array(
    name: str, value: ArrayLike | None, shape: int | tuple[int, int], default: float = 0.0
) -> Array:
    return np.full(shape, default) if value is None else real_array(f"QP.{name}", value)


def check_qp(qp: QP) -> None:
    """Raise unless the QP is well formed. Costs 6-9 us at n = 35.

    Raises
    ------
    InvalidInputError
        There is no unknown; a field has another shape than the rest, holds NaN (or infinity, where
        that is no bound), or a lower bound lies above its upper bound; the message names the field
        or the row.
    """
    mi = qp.u.size
    if (
        is_sound(qp)
        # NaN fails the comparison; the extremes refuse +inf as lower and -inf as upper bound.
        and np.logical_and.reduce(qp.lower <= qp.upper)
        and np.maximum.reduce(qp.lower) < np.inf
        and np.minimum.reduce(qp.upper) > -np.inf
        and (not mi or np.logical_and.reduce(qp.l <= qp.u))
        and (not mi or np.maximum.reduce(qp.l) < np.inf)
        and (not mi or np.minimum.reduce(qp.u) > -np.inf)
    ):
        return
    raise InvalidInputError(next(_faults(qp), "QP: entries too large to be squared"))


def is_sound(qp: QP) -> bool:
    """Return whether shapes agree and all numbers but the bounds are finite.

    Half of :func:`check_qp`; enough if the solution is checked against the bounds afterwards, which
    fails for malformed ones.
    """
    n, me, mi, names = qp.g.size, qp.b.size, qp.u.size, qp.labels
    P, A, C, g, b = qp.P, qp.A, qp.C, qp.g, qp.b
    return (
        n > 0
        and P.shape == (n, n)
        and A.shape == (me, n)
        and C.shape == (mi, n)
        and g.shape == qp.lower.shape == qp.upper.shape == (n,)
        and qp.l.shape == qp.u.shape == (mi,)
        and b.shape == (me,)
        and (len(names.variables), len(names.equality), len(names.inequality)) == (n, me, mi)
        # A sum of squares is finite exactly when every entry is; three times cheaper than
        # np.isfinite(...).all(), and unlike a plain sum it never meets inf - inf.
        and math.isfinite(
            np.vdot(P, P) + np.vdot(g, g) + np.vdot(A, A) + np.vdot(b, b) + np.vdot(C, C)
        )
    )


def _faults(qp: QP) -> Iterator[str]:
    """Yield descriptions of the QP's faults; slow, run on failure only."""
    n, me, mi = qp.g.size, qp.b.size, qp.u.size
    if not n:
        yield "QP.g: no entries; a QP is about one unknown at least"
    shapes = {"P": (n, n), "g": (n,), "A": (me, n), "b": (me,), "C": (mi, n)}
    shapes |= {"l": (mi,), "u": (mi,), "lower": (n,), "upper": (n,)}
    for field, shape in shapes.items():
        got = getattr(qp, field).shape
        if got != shape:
            yield (
                f"QP.{field}: expected shape {shape} (g has {n}, b {me} and u {mi} entries), "
                f"got {got}"
            )
    sizes = {"variables": n, "equality": me, "inequality": mi}
    for field, size in sizes.items():
        found = len(getattr(qp.labels, field))
        if found != size:
            yield (
                f"QP.labels.{field}: expected {size} names, got {found}; "
                "make the labels for this contact set"
            )
    variables, equality, inequality = (getattr(qp.labels, field) for field in sizes)
    names = {"P": variables, "A": equality, "C": inequality, "g": variables, "b": equality}
    for field in names:
        bad = np.argwhere(~(np.abs(getattr(qp, field)) < LARGEST)).tolist()
        if bad:
            name = names[field][bad[0][0]]
            yield (
                f"QP.{field}: NaN, infinite or beyond {LARGEST:g} at index {bad[:5]} ({name!r}); "
                "check the task or constraint that wrote it"
            )
    for low, high, rows in (("l", "u", inequality), ("lower", "upper", variables)):
        lower, upper = getattr(qp, low), getattr(qp, high)
        for i in np.flatnonzero(~((lower <= upper) & (lower < np.inf) & (upper > -np.inf))):
            yield (
                f"QP.{low}, QP.{high}: {rows[i]!r} must lie between {lower[i]:g} and {upper[i]:g}, "
                "which no number does; check the limits that wrote it"
            )
