"""Infeasible QPs: the certificate that proves it, and the names of the conflicting rows.

Multipliers y, z, z_box with ``y'A + z'C + z_box' = 0`` are a Farkas certificate (Boyd &
Vandenberghe, Convex Optimization, sec. 5.8) if the sum

    y'b + z+'u - z-'l + z_box+'upper - z_box-'lower

is negative, while a feasible x would make it >= 0. We check the sum, and trust no solver's status
or accuracy. The core's active-set method finds one among linearly independent rows and one
dependent row, so that none is redundant: the named conflict is irreducible.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import svd

from wbc.qp.core import DONE, solve_in_core
from wbc.qp.problem import QP
from wbc.qp.solution import Conflict, ConflictRow
from wbc.validate import Array

# Share of the tolerance that the recomputed gap must reach: the core scales rows differently.
_RECHECK_SHARE = 0.5
# Shorter combinations of unit rows count as 0.
_ZERO = 1e-9
# Weights below this share of the largest count as 0.
_ROUNDING = 1e-3 * _ZERO
# Share of the gap that unknowns within REACH may close if a row is dropped.
_NEGLIGIBLE_CLOSING = 0.1
# Unknowns are assumed to stay within this, which multiplies the rounding of y'A + z'C + z_box'.
REACH = 1e6
# Rows scaled to unit length count as met within this times (1 + their ends).
TOLERANCE = 1e-7
# Tolerance where no point is found at that one: a certificate's sums are still far above rounding.
FINEST = 2e-9
_MOST_ITERATIONS = 1000
# Damping of unknowns that the least violation does not determine, tried in this order: with the
# smallest the active-set method can fail if many rows are nearly dependent.
_DAMPINGS = 1e-10, 1e-8, 1e-6
_EPS = 1e-11
_SVD_DRIVER = "gesvd"  # "gesdd" fails to converge once in thousands of random ticks


def find_conflict(
    qp: QP, tolerance: float = TOLERANCE, guess: Array | None = None
) -> Conflict | None:
    """Return an irreducible set of conflicting rows; None: feasible, or undecided.

    The core projects ``guess`` onto the feasible set: if that is empty, it returns a certificate.

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
    # For infeasible QPs some solvers return a ray: a point at 1e200, or NaN.
    if guess is not None and (np.abs(guess) <= REACH).all():
        start = np.clip(guess, qp.lower, qp.upper)
        if (np.abs(UnitRows.of(qp).violation(start)) <= tolerance).all():
            return None
    nearest = qp._replace(P=np.eye(qp.g.size), g=-start)
    found = solve_in_core(nearest, 1e-8, _MOST_ITERATIONS)
    if found.status == DONE:
        return None
    proved = conflict_of(qp, found.y, found.z, found.z_box, tolerance)
    return proved or conflict_by_simplex(qp, tolerance)  # if the active-set method fails


def conflict_by_simplex(qp: QP, tolerance: float = TOLERANCE) -> Conflict | None:
    """Return the conflict found by the dual simplex, as a last resort: takes milliseconds.

    The largest violation of a row of unit length is minimised within the bounds, by HiGHS (Huangfu
    & Hall, Math. Programming Computation 10, 2018); multipliers of the optimum are the certificate.
    """
    from scipy.optimize import linprog  # only here: it takes a while to load

    rows, n = UnitRows.of(qp), qp.g.size
    above, below = np.isfinite(rows.upper), np.isfinite(rows.lower)
    sides = np.concatenate((rows.matrix[above], -rows.matrix[below]))
    found = linprog(
        np.append(np.zeros(n), 1.0),
        A_ub=np.column_stack((sides, -np.ones(len(sides)))),
        b_ub=np.concatenate((rows.upper[above], -rows.lower[below])),
        bounds=[*zip(qp.lower, qp.upper, strict=True), (0.0, None)],
        method="highs-ds",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    if found.status != 0:
        return None
    pulls, weights = -found.ineqlin.marginals, np.zeros(rows.norms.size)
    weights[above] += pulls[: above.sum()]
    weights[below] -= pulls[above.sum() :]
    weights /= rows.norms
    z_box, me = -(found.lower.marginals + found.upper.marginals)[:n], qp.b.size
    return conflict_of(qp, weights[:me], weights[me:], z_box, tolerance)


def conflict_of(
    qp: QP, y: Array, z: Array, z_box: Array, tolerance: float = TOLERANCE
) -> Conflict | None:
    """Return the rows of a certificate, the heaviest first; None if it is not one.

    ``y``, ``z``, ``z_box``: (me,), (mi,), (n,) multipliers, with the signs of a solution's.
    """
    rows = UnitRows.of(qp)
    weights = np.append(np.append(y, z) * rows.norms, z_box)
    if not np.isfinite(weights).all():
        return None
    # From here on rows are signed so that each has an upper end and a positive weight.
    signs, pulls = np.sign(weights), np.abs(weights)
    every = signs[:, None] * np.concatenate((rows.matrix, np.eye(qp.g.size)))
    upper, lower = np.append(rows.upper, qp.upper), np.append(rows.lower, qp.lower)
    ends = np.where(weights > 0.0, upper, -lower)
    named = np.flatnonzero((pulls > 0.0) & np.isfinite(ends))  # other pulls are rounding
    matrix, end, own = every[named], ends[named], pulls[named]
    exact = _irreducible(own, _null_space(matrix.T), end)
    if not (gap := _gap(matrix, end, exact, tolerance)):  # rows that nearly depend on each other
        exact, gap = own, _gap(matrix, end, own, tolerance)
    if not gap:
        return None
    while (less := _without_redundant(matrix, end, exact, tolerance)) is not None:
        exact, gap = less
    return _conflict_rows(qp, rows, named, exact, signs[named], gap)


def _gap(matrix: Array, ends: Array, weights: Array, tolerance: float) -> float:
    """Return the gap of a certificate (s,) of rows (s, n); 0 if it may be rounding."""
    gap = -float(weights @ ends)
    enough = _RECHECK_SHARE * tolerance * float(weights @ (1.0 + np.abs(ends)))
    return gap if gap - _closable(matrix, weights) >= enough else 0.0


def _closable(matrix: Array, weights: Array) -> float:
    """Return how much of a gap unknowns within REACH can close at most."""
    return REACH * float(np.abs(weights @ matrix).sum())


def _irreducible(weights: Array, free: Array, ends: Array) -> Array:
    """Return an irreducible certificate (s,) near this one; 0 if there is none.

    A certificate is a combination of rows that is 0; ``free`` (s, k) spans all of them, and the
    core knows it up to rounding or damping. While there are several, a row's weight is brought to 0
    along those that leave the gap unchanged (Caratheodory's theorem). Weights below ROUNDING of the
    largest are 0.
    """
    kept, own, found = np.arange(weights.size), weights, np.zeros(weights.size)
    while free.shape[1]:
        own = free @ (own @ free)
        gone = own <= _ROUNDING * own.max()
        if gone.any():  # drop the smallest only: others may grow again without it
            first = np.where(gone, weights[kept], np.inf).argmin()
        elif free.shape[1] == 1:
            found[kept] = own
            break
        else:  # move along a direction of equal gap until some row's weight is 0
            direction = free @ _null_space((ends[kept] @ free)[None, :])[:, 0]
            direction *= np.copysign(1.0, direction.sum())
            first = (direction / own).argmax()
            own = own - own[first] / direction[first] * direction
        free = free @ _null_space(free[first : first + 1])
        free, kept = np.delete(free, first, axis=0), np.delete(kept, first)
        own = np.delete(own, first)
    return found


def _without_redundant(
    matrix: Array, ends: Array, weights: Array, tolerance: float
) -> tuple[Array, float] | None:
    """Return a certificate (s,) of fewer rows (s, n), and its gap; None if every row is needed.

    Without a row the others are independent, but may be so nearly dependent that they could only be
    met far beyond REACH: then that row is dropped. The shortest combination without row k is, with
    G the pseudo-inverse of the rows' products and w the certificate, w - G_k w_k / G_kk.
    """
    kept = np.flatnonzero(weights)
    own = weights[kept]
    left, values, _ = svd(matrix[kept], lapack_driver=_SVD_DRIVER)
    size = min(values.size, kept.size - 1)  # all but the certificate itself
    inverse = left[:, :size] / values[:size]
    products = inverse @ inverse.T
    for k in np.argsort(own, kind="stable").tolist():
        if products[k, k] == 0.0:  # there is no combination without it
            continue
        less = own - products[k] * (own[k] / products[k, k])
        less[k] = 0.0
        if (less < 0.0).any():
            continue
        gap = _gap(matrix[kept], ends[kept], less, tolerance)
        if _closable(matrix[kept], less) < _NEGLIGIBLE_CLOSING * gap:
            found = np.zeros(weights.size)
            found[kept] = less
            return found, gap
    return None


def _null_space(matrix: Array) -> Array:
    """Return an orthonormal basis (n, k) of a matrix's (m, n) null space, up to _ZERO."""
    _, values, right = svd(matrix, lapack_driver=_SVD_DRIVER)
    rank = np.count_nonzero(values > _ZERO * values.max(initial=1.0))
    basis: Array = right[rank:].T
    return basis


def _conflict_rows(
    qp: QP, rows: UnitRows, named: NDArray[np.int64], weights: Array, signs: Array, gap: float
) -> Conflict:
    """Return the conflict; violations are those of the nearest point within the bounds."""
    m, me = rows.norms.size, qp.b.size
    names = (*qp.labels.equality, *qp.labels.inequality, *qp.labels.variables)
    # Scale of the least-squares violation of a point within the bounds.
    share = gap / max(float(np.square(weights[named < m]).sum()), np.finfo(float).tiny)
    found = []
    for k in np.argsort(-weights, kind="stable")[: np.count_nonzero(weights)].tolist():
        row, weight = int(named[k]), share * float(weights[k])
        length = float(rows.norms[row]) if row < m else 1.0
        missed = weight * length if row < m else 0.0
        upper = "upper" if signs[k] > 0.0 else "lower"
        side = "equality" if row < me else f"{upper} limit" if row < m else f"{upper} bound"
        found.append(ConflictRow(names[row], missed, float(signs[k]) * weight / length, side))
    return Conflict(tuple(found))


def _crossed(qp: QP) -> tuple[ConflictRow, ...]:
    """Return the row or bound whose lower end exceeds its upper end the most."""
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


def least_violation(qp: QP) -> tuple[Array, Array]:
    """Return the point within the bounds that violates the rows least, and by how much.

    Returns
    -------
    x : Array
        (n,).
    violation : Array
        (me + mi,), equality rows first, in the rows' own units: positive above, negative below.
        "Least" is in the sense of least squares over rows scaled to unit length.
    """
    rows, n = UnitRows.of(qp), qp.g.size
    if not rows.norms.size:
        return np.clip(np.zeros(n), qp.lower, qp.upper), np.zeros(0)
    none = np.zeros((0, n))
    elastic = qp._replace(
        g=np.zeros(n), A=none, b=np.zeros(0), C=rows.matrix, l=rows.lower, u=rows.upper
    )
    for damping in _DAMPINGS:
        damped = elastic._replace(P=damping * np.eye(n))
        found = solve_in_core(damped, _EPS, _MOST_ITERATIONS, np.ones(rows.norms.size))
        if found.status == DONE:
            break
    x = np.where(np.isfinite(found.x), found.x, 0.0) if found.iterations >= 0 else np.zeros(n)
    x = np.clip(x, qp.lower, qp.upper)
    return x, rows.violation(x) * rows.norms
