"""From a solver's claim to a status that rests on evidence: the same check for every backend.

How far a point and its multipliers are from optimal is worked out from the QP, apart from any
solver. No status of any is believed: each has claimed "solved" or "infeasible" wrongly somewhere.
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

# Part of the cost's terms that an accepted point may cost too much by the look of its multipliers.
DOUBT = 1e-4
# A point or multipliers beyond this are no answer: products of three overflow, where the numbers of
# the QP are 1e150 at most.
FARTHEST = 1e70


def kkt_residuals(qp: QP, x: Array, y: Array, z: Array, z_box: Array) -> KktResiduals:
    """Return the residuals of x (n,), y (me,), z (mi,), z_box (n,); infinite where one is too."""
    point = np.concatenate((z_box, z, y, x))
    if np.vdot(point, point) > FARTHEST * FARTHEST:  # NaN is not, and stays
        return KktResiduals(math.inf, math.inf, math.inf)
    return KktResiduals(*residuals_in_core(qp, x, y, z, z_box))


def is_accurate(residuals: Sequence[float], eps: float) -> bool:
    """Whether the three residuals that ``residuals`` begins with are below ``eps``; NaN is not."""
    primal, dual, complementarity, *_ = residuals
    return primal <= eps and dual <= eps and complementarity <= eps


def acceptable(
    residuals: KktResiduals, eps: float, qp: QP, x: Array, y: Array, z: Array, z_box: Array
) -> bool:
    """Whether the residuals are below eps, or below eps relative to the terms they are made of.

    Each row is measured by its own terms: a row of large numbers does not excuse the others. Nor do
    multipliers: diverging ones (1e8, even 1e26) would make any residual small beside them, hence
    the cost that they leave in doubt must be small beside the cost's own terms. The relative test
    is only made when the plain one fails.
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
        and doubtful_cost(qp, x, y, z, z_box) <= DOUBT * cost
    )


def doubtful_cost(qp: QP, x: Array, y: Array, z: Array, z_box: Array) -> float:
    """Return the duality gap, multipliers times distances to bounds, and the gradient left over x.

    Multipliers smaller than the distance are left out: there, they are what should be 0.
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
    """Whether each row lies between its ends, to eps relative to its own largest term."""
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
        return Solution(
            *raw[:4],
            status=status,
            residuals=residuals,
            iterations=raw.iterations,
            solve_time=perf_counter() - self.started,
            solver=self.solver,
            conflict=conflict,
            attempts=attempts,
            message=raw.message,
        )
