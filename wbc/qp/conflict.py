"""Which rows make a QP infeasible: the certificate that proves it, and the rows by their names.

Multipliers y, z, z_box with ``y'A + z'C + z_box' = 0`` are a Farkas certificate (Boyd &
Vandenberghe, Convex Optimization, sec. 5.8) if the sum

    y'b + z+'u - z-'l + z_box+'upper - z_box-'lower

is negative, where a feasible x would make it >= 0. The sum is what we check: no solver's status or
accuracy is believed. The core's active-set method finds one among linearly independent rows and
one that depends on them, so that no row can be spared: the conflict named is irreducible.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.qp.core import INFEASIBLE, solve_in_core
from wbc.qp.problem import QP
from wbc.qp.solution import Conflict, ConflictRow
from wbc.validate import Array

# Rows of the certificate lighter than this part of the heaviest, scaled to unit length, are
# rounding.
_LIGHTEST = 1e-7
# Part of the tolerance that must survive the check: the core looked at it in other numbers.
_SURVIVING = 0.5
# A row that the others nearly give back: its direction is not one of the certificate alone.
_UNIQUE = 1e-9
# Unknowns are assumed to stay within this: what rounding leaves of y'A + z'C + z_box' counts so
# often.
REACH = 1e6
# Rows scaled to unit length count as met within this, by 1 + their ends.
TOLERANCE = 1e-7
_MOST_ITERATIONS = 1000


def find_conflict(
    qp: QP, tolerance: float = TOLERANCE, guess: Array | None = None
) -> Conflict | None:
    """Return rows that contradict each other, none of them needless; None: feasible, or undecided.

    The point of the QP's rows that is nearest to ``guess`` is sought, by the core: where there is
    none, it proves so.

    Parameters
    ----------
    tolerance:
        The QP counts as feasible when every row, scaled to unit length, can be met within
        tolerance (1 + its end). Conflicts below about ten times this remain undecided.
    guess:
        (n,) a point that may be feasible: if it is, nothing is searched.
    """
    crossed = _crossed(qp)
    if crossed:
        return Conflict(crossed)
    start = np.zeros(qp.g.size)
    if guess is not None and np.isfinite(guess).all():
        start = np.clip(guess, qp.lower, qp.upper)
        violation = UnitRows.of(qp).violation(start)
        if np.abs(violation).max(initial=0.0) <= tolerance * (1.0 + np.abs(start).max(initial=0.0)):
            return None
    nearest = qp._replace(P=np.eye(qp.g.size), g=-start)
    found = solve_in_core(nearest, 1e-8, _MOST_ITERATIONS)
    if found.said != INFEASIBLE:
        return None
    return conflict_of(qp, found.y, found.z, found.z_box, tolerance)


def conflict_of(
    qp: QP, y: Array, z: Array, z_box: Array, tolerance: float = TOLERANCE
) -> Conflict | None:
    """Return the rows of a certificate, the heaviest first; None: it proves nothing.

    Parameters
    ----------
    y, z, z_box:
        (me,), (mi,), (n,) multipliers, as those of a solution: what one points at is violated.
    """
    rows = UnitRows.of(qp)
    weights = np.concatenate((np.concatenate((y, z)) * rows.norms, z_box))
    if not np.isfinite(weights).all() or not weights.any():
        return None
    named = np.flatnonzero(np.abs(weights) > _LIGHTEST * np.abs(weights).max())
    ends = _ends(qp, rows, weights)[named]
    matrix = np.concatenate((rows.matrix, np.eye(qp.g.size)))[named]  # (s, n)
    weights = _exactly(matrix, weights[named])
    if not np.isfinite(ends).all():
        return None
    leak = REACH * float(np.abs(weights @ matrix).sum())
    gap = -float(weights @ ends)
    if not gap - leak >= _SURVIVING * tolerance * float(np.abs(weights) @ (1.0 + np.abs(ends))):
        return None
    return _named(qp, rows, named, weights, gap)


def _ends(qp: QP, rows: UnitRows, weights: Array) -> Array:
    """Return what each row's, then each bound's, multiplier points at, of unit rows."""
    lower = np.concatenate((rows.lower, qp.lower))
    return np.where(weights > 0.0, np.concatenate((rows.upper, qp.upper)), lower)


def _exactly(matrix: Array, weights: Array) -> Array:
    """Return the combination (s,) of the rows (s, n) that is 0 to rounding, if it is the only one.

    The core knows it to what its pivots leave.
    """
    left, values, _ = np.linalg.svd(matrix)
    rank = int(np.count_nonzero(values > _UNIQUE * values[0])) if values.size else 0
    if rank != len(matrix) - 1:
        return weights
    exact: Array = left[:, -1]
    exact = exact * (exact @ weights)
    return exact if (np.sign(exact) == np.sign(weights)).all() else weights


def _named(
    qp: QP, rows: UnitRows, named: NDArray[np.int64], weights: Array, gap: float
) -> Conflict:
    """Return the conflict; violations are those of the nearest point within the bounds."""
    m, me = rows.norms.size, qp.b.size
    names = (*qp.labels.equality, *qp.labels.inequality, *qp.labels.variables)
    # Of the least sum of squares that a point within the bounds misses the rows by.
    share = gap / max(float(np.square(weights[named < m]).sum()), np.finfo(float).tiny)
    found = []
    for k in np.argsort(-np.abs(weights), kind="stable").tolist():
        row, weight = int(named[k]), share * float(weights[k])
        length = float(rows.norms[row]) if row < m else 1.0
        missed = abs(weight) * length if row < m else 0.0
        upper = "upper" if weight > 0.0 else "lower"
        side = "equality" if row < me else f"{upper} limit" if row < m else f"{upper} bound"
        found.append(ConflictRow(names[row], missed, weight / length, side))
    return Conflict(tuple(found))


def _crossed(qp: QP) -> tuple[ConflictRow, ...]:
    """Return the row or bound whose lower end lies most above the upper: no solver is needed."""
    rows = []
    for lower, upper, names in (
        (qp.l, qp.u, qp.labels.inequality),
        (qp.lower, qp.upper, qp.labels.variables),
    ):
        gap = lower - upper
        for k in np.flatnonzero(gap > 0.0):
            rows.append(ConflictRow(names[k], float(gap[k]), 1.0, "crossed limits"))
    return tuple(sorted(rows, key=lambda row: -row.violation)[:1])


class UnitRows(NamedTuple):
    """Equality rows, then inequality rows, each scaled to unit length."""

    matrix: Array  # (m, n)
    lower: Array  # (m,)
    upper: Array  # (m,)
    norms: Array  # (m,) original lengths, 1 for a zero row

    @classmethod
    def of(cls, qp: QP) -> UnitRows:
        """Return the rows of a QP."""
        matrix = np.concatenate((qp.A, qp.C))
        norms = np.linalg.norm(matrix, axis=1)
        norms[norms == 0.0] = 1.0
        lower, upper = np.concatenate((qp.b, qp.l)), np.concatenate((qp.b, qp.u))
        return cls(matrix / norms[:, None], lower / norms, upper / norms, norms)

    def violation(self, x: Array) -> Array:
        """Return (m,) by how much x violates each row: positive above, negative below."""
        values = self.matrix @ x
        return values - np.clip(values, self.lower, self.upper)
