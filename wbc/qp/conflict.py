"""Which rows make a QP infeasible: least violation, the certificate it gives, a smallest set.

The elastic problem keeps the bounds and relaxes every row, scaled to unit length,

    minimise 1/2 |s|^2  subject to  A x - s_e = b,  l <= C x - s_i <= u,  lower <= x <= upper.

Its residual s is zero exactly when the QP is feasible. If it is not, y = s_e, z = s_i and
z_box = -(A'y + C'z) are a Farkas certificate (Boyd & Vandenberghe, Convex Optimization, sec. 5.8):
a feasible x would give

    0 = y'Ax + z'Cx + z_box'x <= y'b + z+'u - z-'l + z_box+'upper - z_box-'lower,

and that sum is negative. The sum is what we check: no solver's status or accuracy is believed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import daqp
import numpy as np

from wbc.qp.problem import QP
from wbc.qp.solution import Conflict, ConflictRow
from wbc.qp.work import Work, afforded_search, search
from wbc.validate import Array

# Rows below this share of the heaviest one are violated by rounding: no exact step holds them.
_SHARE = 1e-3
# Rows below the first of these shares that the others do without take no part in the conflict. With
# the first alone, one conflict in sixty had none in the rows that were named.
_SHARES = _SHARE, 1e-6, 1e-9
# Part of the conflict's own size, |s|^2, that must survive rounding for a certificate to count.
_SURVIVING = 0.5
_ROUNDING = 1e-13  # relative to the terms of a sum
# Unknowns without bounds are assumed to stay within this multiple of the least violation's.
REACH = 1e6
# A bound counts as active within this.
_NEAR = 1e-8
# Accuracy of the elastic problem; the pivots that DAQP avoids by solving again from scratch (its
# own 1e-8 is above what the damping leaves of rows in conflict: 76 iterations took 3.2 ms, now
# 0.4); what unknowns are damped by, which need not be determined; and a cap. Of 465 QPs from wild
# states all got the verdict that ProxQP's point gives, which takes twice as long; with a damping of
# 1e-8 three conflicts were not found.
_EPS, _PIVOT, _DAMPING, _MAX_ITERATIONS = 1e-11, 1e-12, 1e-10, 300
_EQUALITY = 5  # DAQP's code for a row that always holds
# Larger conflicts are not reduced: each row costs one more linear program.
MOST_ROWS = 80


def find_conflict(
    qp: QP, tolerance: float = 1e-7, guess: Array | None = None, work: Work | None = None
) -> Conflict | None:
    """Return the rows that contradict each other; None when the QP is feasible, or undecided.

    Takes milliseconds: for failed ticks only. All rows of the certificate are named; the conflict
    need not be the smallest, and other conflicts may hide behind it.

    Parameters
    ----------
    tolerance:
        The QP counts as feasible when every row, scaled to unit length, can be met within
        tolerance (1 + max |x|). Conflicts below about ten times this remain undecided.
    guess:
        (n,) a point that may be feasible: if it is, nothing is searched.
    work:
        Of the tick: if it does not afford a search, QPs stay undecided.
    """
    crossed = _crossed(qp)
    if crossed:
        return Conflict(crossed)
    rows = _UnitRows.of(qp)
    if not rows.norms.size:
        return None
    if guess is not None and np.isfinite(guess).all():
        inside = np.clip(guess, qp.lower, qp.upper)
        if _is_met(rows.violation(inside), inside, tolerance):
            return None
    work = Work() if work is None else work
    if not work.affords(search(qp), "a search for the rows in conflict"):
        return None
    x = _elastic(qp, rows, work)
    for point in (_polished(qp, rows, x), x):
        violation = rows.violation(point)
        if _is_met(violation, point, tolerance):
            return None
        box = -violation @ rows.matrix  # (n,)
        size = float(np.abs(point).max())
        if _is_certificate(qp, rows, violation, box, size, tolerance):
            return _named(qp, rows, *_essential(qp, rows, violation, box, size))
    return None


def _essential(
    qp: QP, rows: _UnitRows, violation: Array, box: Array, size: float
) -> tuple[Array, Array]:
    """Return a certificate, (m,) and (n,), without light rows and bounds that it does not need."""
    ends = np.abs(np.where(violation > 0.0, rows.upper, rows.lower))
    for share in _SHARES:
        least = share * np.abs(violation).max()
        weighted = np.abs(violation) > least
        heavy = np.where(weighted, violation, 0.0)
        pulls = -heavy @ rows.matrix  # (n,)
        rounding = _ROUNDING * ((1.0 + ends[weighted]) @ np.abs(rows.matrix[weighted]))
        pulls[np.abs(pulls) <= rounding] = 0.0
        named = np.abs(pulls) > least
        if _is_certificate(qp, rows, heavy, pulls, size, 0.0, named):
            return heavy, np.where(named, pulls, 0.0)
    return violation, box


def _is_met(violation: Array, point: Array, tolerance: float) -> bool:
    return bool(np.abs(violation).max() <= tolerance * (1.0 + np.abs(point).max()))


def least_violation(qp: QP, work: Work | None = None) -> tuple[Array, Array]:
    """Return the point within the bounds that violates the rows least, and by how much.

    ``work``: of the tick.

    Returns
    -------
    x : Array
        (n,).
    violation : Array
        (me + mi,), equality rows first, in the rows' own units: positive above, negative below.
        "Least" is in the sense of least squares over rows scaled to unit length.
    """
    rows = _UnitRows.of(qp)
    if not rows.norms.size:
        return np.clip(np.zeros(qp.g.size), qp.lower, qp.upper), np.zeros(0)
    rough = _elastic(qp, rows, Work() if work is None else work)
    points = _polished(qp, rows, rough), rough
    x = min(points, key=lambda point: np.square(rows.violation(point)).sum())
    return x, rows.violation(x) * rows.norms


@dataclass(frozen=True, slots=True, eq=False)
class _UnitRows:
    """Equality rows, then inequality rows, each scaled to unit length."""

    matrix: Array  # (m, n)
    lower: Array  # (m,)
    upper: Array  # (m,)
    norms: Array  # (m,) original lengths, 1 for a zero row

    @classmethod
    def of(cls, qp: QP) -> _UnitRows:
        matrix = np.concatenate((qp.A, qp.C))
        norms = np.linalg.norm(matrix, axis=1)
        norms[norms == 0.0] = 1.0
        lower, upper = np.concatenate((qp.b, qp.l)), np.concatenate((qp.b, qp.u))
        return cls(matrix / norms[:, None], lower / norms, upper / norms, norms)

    def violation(self, x: Array) -> Array:
        """Return (m,) by how much x violates each row: positive above, negative below."""
        values = self.matrix @ x
        return values - np.clip(values, self.lower, self.upper)


def _elastic(qp: QP, rows: _UnitRows, work: Work) -> Array:
    """Return x (n,) of the elastic problem, by DAQP; its quality is checked later."""
    n, m, me = qp.g.size, rows.norms.size, qp.b.size
    P = np.eye(n + m)
    P[range(n), range(n)] = _DAMPING
    relaxed = np.concatenate((rows.matrix, -np.eye(m)), axis=1)  # (m, n + m)
    free = np.full(m, np.inf)
    sense = np.zeros(n + m + m, dtype=np.intc)
    sense[n + m : n + m + me] = _EQUALITY
    upper = np.concatenate((qp.upper, free, rows.upper))
    lower = np.concatenate((qp.lower, -free, rows.lower))
    limit = afforded_search(qp, work.left, _MAX_ITERATIONS)
    asked = {"primal_tol": _EPS, "pivot_tol": _PIVOT, "iter_limit": limit}
    x, _, _, info = daqp.solve(P, np.zeros(n + m), relaxed, upper, lower, sense, **asked)
    work.spent += search(qp, info["iterations"])
    return np.clip(np.where(np.isfinite(x[:n]), x[:n], 0.0), qp.lower, qp.upper)


def _polished(qp: QP, rows: _UnitRows, x: Array) -> Array:
    """Return the exact least violation for the bounds and rows that are active at x.

    With these fixed it is a plain least-squares problem, whose residual is orthogonal to the free
    columns to rounding: a solver's 1e-9 would drown the certificate of a small conflict.
    """
    violation = rows.violation(x)
    gradient = np.abs(violation @ rows.matrix)
    clearance = np.minimum(x - qp.lower, qp.upper - x)
    least = _SHARE * np.abs(violation).max()
    free = (clearance > _NEAR) | (gradient <= least)
    violated = np.abs(violation) > least
    violated[: qp.b.size] = True
    target = np.where(violation > 0.0, rows.upper, rows.lower)[violated]
    active = rows.matrix[violated]
    polished = np.where(free, 0.0, x)
    polished[free] = np.linalg.lstsq(active[:, free], target - active @ polished, rcond=None)[0]
    return np.clip(polished, qp.lower, qp.upper)


def _is_certificate(
    qp: QP,
    rows: _UnitRows,
    violation: Array,
    box: Array,
    size: float,
    tolerance: float,
    named: Array | bool = True,
) -> bool:
    """Whether the certificate proves that no x can exist (within reach, where x is unbounded).

    ``named`` (n,): whose bounds may be used. ``size`` is that of the largest unknown.
    It must hold in the QP's own numbers: with every row and bound relaxed by ``tolerance`` in its
    own units, relative to its end, and whatever rounding did to the sum.
    """
    target = np.where(violation > 0.0, rows.upper, rows.lower)
    bound = np.where(box > 0.0, qp.upper, qp.lower)
    bounded = np.isfinite(bound) & named
    weighted = violation != 0.0
    total = violation[weighted] @ target[weighted] + box[bounded] @ bound[bounded]
    leak = np.abs(box[~bounded]).sum() * REACH * (1.0 + size)
    weight, weight_box = np.abs(violation[weighted]), np.abs(box[bounded])
    ends, ends_box = np.abs(target[weighted]), np.abs(bound[bounded])
    own = weight @ (1.0 / rows.norms[weighted] + ends) + weight_box @ (1.0 + ends_box)
    cancelled = weight @ np.abs(rows.matrix[weighted])[:, bounded]  # what box was summed from
    rounding = _ROUNDING * (weight @ ends + weight_box @ ends_box + cancelled @ ends_box)
    lost = leak + tolerance * own + rounding
    return bool(total + lost <= -_SURVIVING * (violation @ violation))


def _named(qp: QP, rows: _UnitRows, violation: Array, box: Array) -> Conflict:
    """Return the conflict with the heaviest row first; weights compared for unit-length rows."""
    weights = np.concatenate((violation, box))
    m, me = rows.norms.size, qp.b.size
    names = (*qp.labels.equality, *qp.labels.inequality, *qp.labels.variables)
    found = []
    for k in np.argsort(-np.abs(weights)):
        weight = float(weights[k])
        if weight == 0.0:
            break
        length = float(rows.norms[k]) if k < m else 1.0
        missed = abs(weight) * length if k < m else 0.0
        upper = "upper" if weight > 0.0 else "lower"
        side = "equality" if k < me else f"{upper} limit" if k < m else f"{upper} bound"
        found.append(ConflictRow(names[k], missed, weight / length, side))
    return Conflict(tuple(found))


def _crossed(qp: QP) -> tuple[ConflictRow, ...]:
    """Return the rows and bounds whose lower end lies above the upper: no solver is needed."""
    rows = []
    for lower, upper, names in (
        (qp.l, qp.u, qp.labels.inequality),
        (qp.lower, qp.upper, qp.labels.variables),
    ):
        gap = lower - upper
        for k in np.flatnonzero(gap > 0.0):
            rows.append(ConflictRow(names[k], float(gap[k]), 1.0, "crossed limits"))
    return tuple(sorted(rows, key=lambda row: -row.violation))


def irreducible(qp: QP, conflict: Conflict) -> Conflict:
    """Return a part of ``conflict`` whose rows cannot all hold, but could without any one of them.

    The deletion filter of Chinneck and Dravnieks (1991): rows are left out one by one, the
    lightest first, and stay out if what is left still has no solution, which a linear program
    (HiGHS) decides. About two milliseconds a row: for failed ticks only.

    Parameters
    ----------
    conflict:
        As :func:`find_conflict` returns it for ``qp``.

    Returns
    -------
    Conflict
        Rows and multipliers as in ``conflict``; ``conflict`` itself where it has more than
        ``MOST_ROWS`` rows, or where its rows alone are feasible to the linear program (a conflict
        of the order of its accuracy, 1e-7).
    """
    if len(conflict.rows) > MOST_ROWS or _feasible(qp, conflict.rows):
        return conflict
    kept = list(conflict.rows)
    for row in reversed(conflict.rows):
        without = [other for other in kept if other is not row]
        if not _feasible(qp, without):
            kept = without
    return Conflict(tuple(kept))


def _feasible(qp: QP, members: Sequence[ConflictRow]) -> bool:
    """Whether any x within reach meets the given sides of rows, scaled to unit length, and bounds.

    All others are left out.
    """

    def named(names: tuple[str, ...], *sides: str) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        wanted = {row.label for row in members if row.side in (*sides, "crossed limits")}
        return np.fromiter((name in wanted for name in names), dtype=bool, count=len(names))

    rows, me, names = _UnitRows.of(qp), qp.b.size, qp.labels
    C, lower, upper = rows.matrix[me:], rows.lower[me:], rows.upper[me:]
    above, below = named(names.inequality, "upper limit"), named(names.inequality, "lower limit")
    above, below = above & np.isfinite(upper), below & np.isfinite(lower)
    equal = named(names.equality, "equality")
    least = np.where(named(names.variables, "lower bound"), qp.lower, -np.inf)
    most = np.where(named(names.variables, "upper bound"), qp.upper, np.inf)
    from scipy.optimize import linprog  # a quarter of a second to import, seldom needed

    answer = linprog(
        np.zeros(qp.g.size),
        A_ub=np.concatenate((C[above], -C[below])),
        b_ub=np.concatenate((upper[above], -lower[below])),
        A_eq=rows.matrix[:me][equal],
        b_eq=rows.lower[:me][equal],
        bounds=np.column_stack((np.maximum(least, -REACH), np.minimum(most, REACH))),
    )
    return bool(answer.status == 0)
