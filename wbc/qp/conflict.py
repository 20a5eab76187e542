"""Which rows make a QP infeasible: the nearest compromise, and the certificate it gives.

The elastic problem keeps the bounds and relaxes every row, scaled to unit length,

    minimise 1/2 |s|^2  subject to  A x - s_e = b,  l <= C x - s_i <= u,  lower <= x <= upper.

Its residual s is zero exactly when the QP is feasible. If it is not, y = s_e, z = s_i and
z_box = -(A'y + C'z) are a Farkas certificate (Boyd & Vandenberghe, Convex Optimization, sec. 5.8):
a feasible x would give

    0 = y'Ax + z'Cx + z_box'x <= y'b + z+'u - z-'l + z_box+'upper - z_box-'lower,

and that sum is negative. The sum is what we check, so that neither a solver's status nor its
accuracy has to be believed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wbc.qp.native import Workspace
from wbc.qp.problem import QP, Labels
from wbc.qp.solution import Conflict, ConflictRow
from wbc.validate import Array

__all__ = ["Conflict", "ConflictRow", "compromise", "find_conflict"]

# A row below this share of the heaviest one takes no part in the conflict.
_SHARE = 1e-3
# Part of the conflict's own size, |s|^2, that must survive rounding for a certificate to count.
_SURVIVING = 0.5
# Unknowns without bounds are assumed to stay within this multiple of the compromise.
REACH = 1e3
_EPS, _MAX_ITERATIONS = 1e-8, 200


def find_conflict(qp: QP, tolerance: float = 1e-7) -> Conflict | None:
    """Return the rows that contradict each other; None when the QP is feasible, or undecided.

    Takes milliseconds: for failed ticks only. All rows of the certificate are named; the conflict
    need not be the smallest, and other conflicts may hide behind it.

    Parameters
    ----------
    tolerance:
        The QP counts as feasible when every row, scaled to unit length, can be met within
        tolerance (1 + max |x|). Conflicts below about ten times this remain undecided.
    """
    crossed = _crossed(qp)
    if crossed:
        return Conflict(crossed)
    rows = _Rows.of(qp)
    if not rows.norms.size:
        return None
    x = _compromise(qp, rows)
    for point in (_polished(qp, rows, x), x):
        miss = rows.miss(point)
        if np.abs(miss).max() <= tolerance * (1.0 + np.abs(point).max()):
            return None
        box = -miss @ rows.matrix  # (n,)
        if _contradicts(qp, rows, miss, box, np.abs(point).max()):
            return _named(qp, rows, miss, box)
    return None


def compromise(qp: QP) -> tuple[Array, Array]:
    """Return the point within the bounds that misses the rows least, and by how much.

    Returns
    -------
    x : Array
        (n,).
    miss : Array
        (me + mi,), equality rows first, in the rows' own units: positive above, negative below.
        "Least" is in the sense of least squares over rows scaled to unit length.
    """
    rows = _Rows.of(qp)
    if not rows.norms.size:
        return np.clip(np.zeros(qp.g.size), qp.lower, qp.upper), np.zeros(0)
    rough = _compromise(qp, rows)
    x = min((_polished(qp, rows, rough), rough), key=lambda at: np.square(rows.miss(at)).sum())
    return x, rows.miss(x) * rows.norms


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Equality rows, then inequality rows, each scaled to unit length."""

    matrix: Array  # (m, n)
    lower: Array  # (m,)
    upper: Array  # (m,)
    norms: Array  # (m,) original lengths, 1 for a zero row

    @classmethod
    def of(cls, qp: QP) -> _Rows:
        matrix = np.concatenate((qp.A, qp.C))
        norms = np.linalg.norm(matrix, axis=1)
        norms[norms == 0.0] = 1.0
        lower, upper = np.concatenate((qp.b, qp.l)), np.concatenate((qp.b, qp.u))
        return cls(matrix / norms[:, None], lower / norms, upper / norms, norms)

    def miss(self, x: Array) -> Array:
        """Return (m,) by how much x misses each row: positive above, negative below."""
        values = self.matrix @ x
        return values - np.clip(values, self.lower, self.upper)


def _compromise(qp: QP, rows: _Rows) -> Array:
    """Return x (n,) of the elastic problem, from ProxQP; whether it is good is checked later."""
    n, m, me = qp.g.size, rows.norms.size, qp.b.size
    P = np.zeros((n + m, n + m))
    P[n:, n:] = np.eye(m)
    relaxed = np.concatenate((rows.matrix, -np.eye(m)), axis=1)  # (m, n + m)
    free = np.full(m, np.inf)
    elastic = QP(
        P=P,
        g=np.zeros(n + m),
        A=relaxed[:me],
        b=rows.lower[:me],
        C=relaxed[me:],
        l=rows.lower[me:],
        u=rows.upper[me:],
        lower=np.concatenate((qp.lower, -free)),
        upper=np.concatenate((qp.upper, free)),
        labels=Labels.numbered(n + m, me, m - me),
    )
    answer = Workspace.create(elastic, _EPS, _MAX_ITERATIONS).solve_cold()
    x = np.where(np.isfinite(answer.x[:n]), answer.x[:n], 0.0)
    return np.clip(x, qp.lower, qp.upper)


def _polished(qp: QP, rows: _Rows, x: Array) -> Array:
    """Return the exact compromise for the bounds and rows that are active at x.

    With these fixed it is a plain least-squares problem, whose residual is orthogonal to the free
    columns to rounding: a solver's 1e-9 would drown the certificate of a small conflict.
    """
    miss = rows.miss(x)
    pull = np.abs(miss @ rows.matrix)
    room = np.minimum(x - qp.lower, qp.upper - x)
    free = (room > _EPS) | (pull <= _SHARE * np.abs(miss).max())
    broken = np.abs(miss) > _SHARE * np.abs(miss).max()
    broken[: qp.b.size] = True
    target = np.where(miss > 0.0, rows.upper, rows.lower)[broken]
    active = rows.matrix[broken]
    polished = np.where(free, 0.0, x)
    polished[free] = np.linalg.lstsq(active[:, free], target - active @ polished, rcond=None)[0]
    return np.clip(polished, qp.lower, qp.upper)


def _contradicts(qp: QP, rows: _Rows, miss: Array, box: Array, size: float) -> bool:
    """Whether the certificate proves that no x can exist (within reach, where x is unbounded)."""
    target = np.where(miss > 0.0, rows.upper, rows.lower)
    bound = np.where(box > 0.0, qp.upper, qp.lower)
    bounded = np.isfinite(bound)
    weighted = miss != 0.0
    total = miss[weighted] @ target[weighted] + box[bounded] @ bound[bounded]
    leak = np.abs(box[~bounded]).sum() * REACH * (1.0 + size)
    return bool(total + leak <= -_SURVIVING * (miss @ miss))


def _named(qp: QP, rows: _Rows, miss: Array, box: Array) -> Conflict:
    """Return the conflict with the heaviest row first; weights compared for unit-length rows."""
    weights = np.concatenate((miss, box))
    least = _SHARE * np.abs(miss).max()
    m, me = rows.norms.size, qp.b.size
    names = (*qp.labels.equality, *qp.labels.inequality, *qp.labels.variables)
    found = []
    for k in np.argsort(-np.abs(weights)):
        weight = float(weights[k])
        if abs(weight) <= least:
            break
        length = float(rows.norms[k]) if k < m else 1.0
        violation = abs(weight) * length if k < m else 0.0
        upper = "upper" if weight > 0.0 else "lower"
        side = "equality" if k < me else f"{upper} limit" if k < m else f"{upper} bound"
        found.append(ConflictRow(names[k], violation, weight / length, side))
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
