"""The check of every backend's solution: KKT residuals, and certificates of infeasibility.

Residuals are computed from the QP, independently of the solver. No solver's status is trusted: each
has claimed "solved" or "infeasible" wrongly somewhere.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from time import perf_counter
from typing import NamedTuple

import numpy as np

from wbc.qp.conflict import find_conflict
from wbc.qp.core import residuals_in_core
from wbc.qp.problem import QP
from wbc.qp.solution import Conflict, KktResiduals, RawSolution, Solution, Status
from wbc.validate import Array

# An accepted point may be suboptimal by this share of the cost's terms.
COST_DOUBT = 1e-4
# Points or multipliers beyond this are refused: products of three numbers overflow, with those of
# the QP up to 1e150.
LARGEST_POINT = 1e70


def kkt_residuals(qp: QP, x: Array, y: Array, z: Array, z_box: Array) -> KktResiduals:
    """Return the residuals of x (n,), y (me,), z (mi,), z_box (n,); infinite if these are huge."""
    point = np.concatenate((z_box, z, y, x))
    if np.vdot(point, point) > LARGEST_POINT * LARGEST_POINT:  # NaN is not, and stays
        return KktResiduals(math.inf, math.inf, math.inf)
    return KktResiduals(*residuals_in_core(qp, x, y, z, z_box))


def is_accurate(residuals: Sequence[float], eps: float) -> bool:
    """Return whether the first three of ``residuals`` are below ``eps``; NaN is not."""
    primal, dual, complementarity, *_ = residuals
    return primal <= eps and dual <= eps and complementarity <= eps


def acceptable(
    residuals: KktResiduals, eps: float, qp: QP, x: Array, y: Array, z: Array, z_box: Array
) -> bool:
    """Return whether the residuals are below eps, absolutely or relative to their terms.

    Each row is measured by its own terms, so a row of large numbers does not excuse the others. Nor
    do multipliers: diverging ones (1e8, even 1e26) would make any residual relatively small, hence
    the duality gap must be small relative to the cost's own terms. The relative test is made only
    if the absolute one fails.
    """
    r = residuals
    if is_accurate(r, eps):
        return True
    if not all(map(math.isfinite, r)):
        return False
    primal, dual = reference_magnitudes(qp, x, y, z, z_box)
    cost = 1.0 + abs(float(x @ qp.P @ x)) + abs(float(qp.g @ x))
    return (
        r.primal <= eps * (1.0 + primal)
        and r.dual <= eps * (1.0 + dual)
        and r.complementarity <= eps * (1.0 + max(primal, dual))
        and _within(qp.A, x, qp.b, qp.b, eps)
        and _within(qp.C, x, qp.l, qp.u, eps)
        and doubtful_cost(qp, x, y, z, z_box) <= COST_DOUBT * cost
    )


def doubtful_cost(qp: QP, x: Array, y: Array, z: Array, z_box: Array) -> float:
    """Return the duality gap: multipliers times distances to bounds, plus |gradient| times |x|.

    Multipliers smaller than the distance are left out: of the two they should be 0.
    """
    gradient = qp.P @ x + qp.g + z_box + y @ qp.A + z @ qp.C
    values, multipliers = np.concatenate((x, qp.C @ x)), np.concatenate((z_box, z))
    upper, lower = np.concatenate((qp.upper, qp.u)), np.concatenate((qp.lower, qp.l))
    slack = np.abs(np.where(multipliers > 0.0, upper - values, values - lower))
    pulls = np.abs(multipliers) > slack
    return float(np.abs(multipliers[pulls]) @ slack[pulls] + np.abs(gradient) @ np.abs(x))


def reference_magnitudes(qp: QP, x: Array, y: Array, z: Array, z_box: Array) -> tuple[float, float]:
    """Return (primal, dual): the largest terms in the rows and in the stationarity sum."""
    primal = [largest(x), largest(qp.b), largest(qp.A.dot(x)), largest(qp.C.dot(x))]
    dual = [largest(qp.P.dot(x)), largest(qp.g), largest(z_box)]
    dual += [largest(y.dot(qp.A)), largest(z.dot(qp.C))]
    return max(primal), max(dual)


def _within(rows: Array, x: Array, lower: Array, upper: Array, eps: float) -> bool:
    """Return whether each row lies between its ends, to eps relative to its largest term."""
    terms = rows * x  # (m, n)
    values = terms.sum(axis=1)
    slack = eps * (1.0 + np.abs(terms).max(axis=1))
    return bool(np.all((values >= lower - slack) & (values <= upper + slack)))


def largest(vector: Array) -> float:
    """Return the largest absolute entry, 0 for an empty vector."""
    return float(np.maximum.reduce(np.abs(vector), initial=0.0))


class SolveCheck(NamedTuple):
    """One call of a backend: which solver, what accuracy is promised, and when it started.

    ``explain``: whether rows in conflict are looked for where there is no solution.
    """

    solver: str
    eps: float
    started: float  # perf_counter() at the call
    explain: bool = True

    def accept(self, qp: QP, raw: RawSolution, attempts: int = 1) -> Solution | None:
        """Return the solution when its KKT residuals are small, else None."""
        residuals = kkt_residuals(qp, *raw[:4])
        if not acceptable(residuals, self.eps, qp, *raw[:4]):
            return None
        return self._solution(raw, Status.SOLVED, residuals, attempts)

    def refute(self, qp: QP, raw: RawSolution, attempts: int = 1) -> Solution | None:
        """Return the "infeasible" verdict, with the rows in conflict, when a certificate exists.

        A point that meets every row shows that the QP is feasible, and nothing is searched.
        """
        if not self.explain:
            return None
        residuals = kkt_residuals(qp, *raw[:4])
        if residuals.primal <= self.eps:
            return None
        conflict = find_conflict(qp, guess=raw.x)
        if conflict is None:
            return None
        return self._solution(raw, Status.INFEASIBLE, residuals, attempts, conflict)

    def judge(self, qp: QP, raw: RawSolution, attempts: int = 1) -> Solution:
        """Return the final verdict: accepted, refuted, or the status that is left.

        A claim that the evidence does not support is a failure, and the message says so; otherwise
        the solver's own status stands.
        """
        settled = self.accept(qp, raw, attempts) or self.refute(qp, raw, attempts)
        if settled is not None:
            return settled
        status = raw.claim
        if raw.claim in (Status.SOLVED, Status.INFEASIBLE):
            said = f", and said {raw.message!r}" if raw.message else ""
            message = f"claimed {raw.claim.value!r}, for which there is no evidence{said}"
            raw, status = raw._replace(message=message), Status.FAILED
        return self._solution(raw, status, kkt_residuals(qp, *raw[:4]), attempts)

    def _solution(
        self,
        raw: RawSolution,
        status: Status,
        residuals: KktResiduals,
        attempts: int,
        conflict: Conflict | None = None,
    ) -> Solution:
        spent = perf_counter() - self.started
        known = *raw[:4], status, residuals, raw.iterations, spent, self.solver
        return Solution(*known, conflict, attempts, raw.message)
