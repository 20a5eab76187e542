"""The command when no command meets every row: as little violation as possible, then the task.

Two least-squares problems, one after the other. The first is the elastic problem of
:mod:`wbc.qp.conflict`: the bounds hold, and the rows, scaled to unit length, are missed by as
little as possible. The second minimises the QP's own cost over all points that miss no row by more
than that. (ProxQP's ``primal_infeasibility_solving`` has the same meaning, but shifts bounds as
well as rows; a joint limit is not ours to shift.)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from wbc.qp.conflict import compromise
from wbc.qp.problem import QP
from wbc.qp.proxqp import ProxQP
from wbc.validate import Array

# Relative to 1 + max |x|: rows are opened by this much more than the compromise needs, so that
# rounding cannot close what it just opened.
_OPEN = 1e-9
# A row missed by less than this, scaled to unit length, counts as met.
_MET = 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class Closest:
    """A point within the bounds that misses the rows by as little as any can.

    Attributes
    ----------
    x:
        (n,), within the bounds exactly.
    slack:
        By how much each missed row is missed, by label, in its own units; positive above.
    optimal:
        True if x also minimises the QP's cost among such points; False if that second problem was
        not solved and x is the first one's answer.
    seconds:
        Time taken.
    """

    x: Array
    slack: Mapping[str, float]
    optimal: bool
    seconds: float


def closest(qp: QP, eps: float = 1e-8) -> Closest:
    """Return the closest point to feasible; for a feasible QP its solution.

    Takes milliseconds: for failed ticks only.

    Parameters
    ----------
    eps:
        Accuracy promised by the second problem's solver.
    """
    began = perf_counter()
    point, miss = compromise(qp)
    opened = _opened(qp, miss, _OPEN * (1.0 + float(np.abs(point).max(initial=0.0))))
    solution = ProxQP(eps=eps, warm=False).solve(opened)
    x = np.clip(solution.x if solution.solved else point, qp.lower, qp.upper)
    return Closest(x, _missed(qp, x), solution.solved, perf_counter() - began)


def _opened(qp: QP, miss: Array, more: float) -> QP:
    """Return ``qp`` with its rows shifted so that a point that misses by ``miss`` meets them."""
    me = qp.b.size
    above, below = np.maximum(miss[me:], 0.0), np.minimum(miss[me:], 0.0)
    # An equality that was missed is met at its missed value, exactly: that is what is possible.
    return replace(
        qp,
        b=qp.b + miss[:me],
        l=qp.l + np.where(below < 0.0, below - more, 0.0),
        u=qp.u + np.where(above > 0.0, above + more, 0.0),
    )


def _missed(qp: QP, x: Array) -> dict[str, float]:
    values = qp.C @ x
    miss = np.concatenate((qp.A @ x - qp.b, values - np.clip(values, qp.l, qp.u)))
    length = np.linalg.norm(np.concatenate((qp.A, qp.C)), axis=1)
    names = (*qp.labels.equality, *qp.labels.inequality)
    least = _MET * np.where(length > 0.0, length, 1.0) * (1.0 + float(np.abs(x).max(initial=0.0)))
    return {names[k]: float(miss[k]) for k in np.flatnonzero(np.abs(miss) > least)}
