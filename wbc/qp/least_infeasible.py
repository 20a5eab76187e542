"""The least infeasible point of a QP: least violation of the rows first, then the QP's cost.

First the elastic problem of :mod:`wbc.qp.conflict`: within the bounds, the rows, scaled to unit
length, are violated as little as possible. Then the QP's cost, over all points that violate no row
more than that. (ProxQP's ``primal_infeasibility_solving`` does the same, but shifts bounds as well
as rows; joint limits must not be shifted.)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from wbc.qp.active_set import ActiveSet
from wbc.qp.conflict import UnitRows, least_violation
from wbc.qp.kkt import largest
from wbc.qp.problem import QP
from wbc.validate import Array

# Relative to 1 + max |x|: extra relaxation of rows, against rounding.
_RELAXED = 1e-9
# A row violated by less than this, scaled to unit length, counts as met.
_MET = 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class LeastInfeasible:
    """A point within the bounds that violates the rows by as little as any can."""

    x: Array  # (n,), within the bounds exactly
    # The violation of each violated row, by label, in its own units; positive above.
    slack: Mapping[str, float]
    # Whether x also minimises the QP's cost among such points; False if that second problem was
    # not solved, and x is the first one's solution.
    optimal: bool
    seconds: float  # time taken


def least_infeasible(qp: QP) -> LeastInfeasible:
    """Return the least infeasible point; for a feasible QP its solution.

    Takes milliseconds: for failed ticks only.
    """
    began = perf_counter()
    point, violation = least_violation(qp)
    margin = _RELAXED * (1.0 + largest(point))
    solution = ActiveSet().solve(_relaxed(qp, violation, margin), quick=True)
    x = np.clip(solution.x if solution.solved else point, qp.lower, qp.upper)
    return LeastInfeasible(x, _violated(qp, x), solution.solved, perf_counter() - began)


def _relaxed(qp: QP, violation: Array, margin: float) -> QP:
    """Return ``qp`` with its rows shifted so that a point with this ``violation`` meets them."""
    me = qp.b.size
    above, below = np.maximum(violation[me:], 0.0), np.minimum(violation[me:], 0.0)
    return qp._replace(
        b=qp.b + violation[:me],  # an equality is met exactly at its violated value
        l=qp.l + np.where(below < 0.0, below - margin, 0.0),
        u=qp.u + np.where(above > 0.0, above + margin, 0.0),
    )


def _violated(qp: QP, x: Array) -> dict[str, float]:
    rows, names = UnitRows.of(qp), (*qp.labels.equality, *qp.labels.inequality)
    missed = rows.violation(x)
    found = np.flatnonzero(np.abs(missed) > _MET * (1.0 + largest(x)))
    return {names[k]: float(missed[k] * rows.norms[k]) for k in found}
