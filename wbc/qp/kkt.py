"""How far a point and its multipliers are from optimal, recomputed from the QP in plain NumPy.

No status of any solver is believed: each has claimed "solved" or "infeasible" wrongly somewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wbc.qp.problem import QP
from wbc.validate import Array


@dataclass(frozen=True, slots=True)
class KktResiduals:
    """Largest absolute violation of each optimality condition, in the QP's own units.

    ``primal``: of a row or bound. ``dual``: of P x + g + A'y + C'z + z_box = 0.
    ``complementarity``: over rows and bounds, the smaller of |multiplier| and the distance to the
    bound that the multiplier's sign points at. The smaller one, and not the product, because a
    bound may be infinite: there the multiplier itself is what is wrong. NaN anywhere stays NaN.
    """

    primal: float
    dual: float
    complementarity: float


def kkt_residuals(qp: QP, x: Array, y: Array, z: Array, z_box: Array) -> KktResiduals:
    """Return the residuals of x (n,), y (me,), z (mi,), z_box (n,); 10-13 us at n = 35.

    References
    ----------
    Boyd & Vandenberghe, Convex Optimization, sec. 5.5.3, with two-sided rows and bounds.
    """
    gradient = qp.P.dot(x)  # (n,)
    gradient += qp.g
    gradient += z_box
    missed = 0.0
    if y.size:
        gradient += y.dot(qp.A)
        rows = qp.A.dot(x)
        rows -= qp.b
        missed = _largest(rows)
    if z.size:
        gradient += z.dot(qp.C)
        values, multipliers = np.concatenate((x, qp.C.dot(x))), np.concatenate((z_box, z))
        upper, lower = np.concatenate((qp.upper, qp.u)), np.concatenate((qp.lower, qp.l))
    else:
        values, multipliers, upper, lower = x, z_box, qp.upper, qp.lower
    above, below = upper - values, values - lower  # negative outside
    outside = -float(np.minimum.reduce(np.minimum(above, below)))
    slack = np.where(multipliers > 0.0, above, below)
    clash = np.minimum(np.abs(slack), np.abs(multipliers))
    return KktResiduals(
        # `outside` first: max(nan, a) is nan, but max(a, nan) is a.
        primal=max(outside, missed, 0.0),
        dual=_largest(gradient),
        complementarity=float(np.maximum.reduce(clash)),
    )


def acceptable(
    residuals: KktResiduals, eps: float, qp: QP, x: Array, y: Array, z: Array, z_box: Array
) -> bool:
    """Whether the residuals are below eps, or below eps relative to the terms they are made of.

    Each row is measured by its own terms: a row of large numbers does not excuse the others. The
    relative test is only made when the plain one fails.
    """
    r = residuals
    if r.primal <= eps and r.dual <= eps and r.complementarity <= eps:
        return True
    primal, dual = reference_magnitudes(qp, x, y, z, z_box)
    return (
        r.primal <= eps * (1.0 + primal)
        and r.dual <= eps * (1.0 + dual)
        and r.complementarity <= eps * (1.0 + max(primal, dual))
        and _within(qp.A, x, qp.b, qp.b, eps)
        and _within(qp.C, x, qp.l, qp.u, eps)
    )


def reference_magnitudes(qp: QP, x: Array, y: Array, z: Array, z_box: Array) -> tuple[float, float]:
    """Return (primal, dual): the largest terms in the rows and in the stationarity sum."""
    primal = [_largest(x), _largest(qp.b), _largest(qp.A.dot(x)), _largest(qp.C.dot(x))]
    dual = [_largest(qp.P.dot(x)), _largest(qp.g), _largest(z_box)]
    dual += [_largest(y.dot(qp.A)), _largest(z.dot(qp.C))]
    return max(primal), max(dual)


def _within(rows: Array, x: Array, lower: Array, upper: Array, eps: float) -> bool:
    """Whether each row lies between its ends, to eps relative to its own largest term."""
    terms = rows * x  # (m, n)
    values = terms.sum(axis=1)
    slack = eps * (1.0 + np.abs(terms).max(axis=1, initial=0.0))
    return bool(np.all((values >= lower - slack) & (values <= upper + slack)))


def _largest(vector: Array) -> float:
    """Return the largest absolute entry, 0 for an empty vector."""
    return float(np.maximum.reduce(np.abs(vector), initial=0.0))
