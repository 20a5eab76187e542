"""From a solver's claim to a status that rests on evidence: the same check for every backend.

How far a point and its multipliers are from optimal is recomputed from the QP in plain NumPy. No
status of any solver is believed: each has claimed "solved" or "infeasible" wrongly somewhere.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from wbc.qp.conflict import find_conflict
from wbc.qp.problem import QP
from wbc.qp.solution import Conflict, KktResiduals, RawSolution, Solution, Status
from wbc.validate import Array

# Part of the cost's terms that an accepted point may cost too much by the look of its multipliers.
DOUBT = 1e-4
# A point or multipliers beyond this are no answer: products of three overflow, where the numbers of
# the QP are 1e150 at most.
FARTHEST = 1e70
MOST = 64  # sets of memory that a thread keeps: margins change the number of rows


class Stacked:
    """Memory for QPs of some size: bounds, inequality rows and equality rows one below the other.

    Attributes
    ----------
    P, g, rows:
        (n, n), (n,) and (mi + me, n): C above A.
    lower, upper:
        (n + mi + me,) of the unknowns, of C x, and b twice.
    x, multipliers:
        (n,) and (n + mi + me,); ``point`` holds both, x last.
    inequalities:
        How many multipliers are not those of equalities, n + mi.
    """

    def __init__(self, n: int, mi: int, me: int) -> None:
        m, every = mi + me, n + mi + me
        self.inequalities = n + mi
        # Rows above P, and the rows' multipliers before x: one product gives the gradient.
        block = np.empty((every + 1) * (n + 1) - 1)
        self.lower, self.upper = block[:every], np.empty(every)
        self._matrices, self.g = block[every:-n].reshape(every, n), block[-n:]
        self.rows, self.P = self._matrices[:m], self._matrices[m:]
        # Where the fields of a QP go, in their order; b goes to the upper ends as well.
        lower, l, b = np.split(self.lower, (n, n + mi))  # noqa: E741
        upper, u, self._b = np.split(self.upper, (n, n + mi))
        self._fields = self.P, self.g, self.rows[mi:], b, self.rows[:mi], l, u, lower, upper
        memory = np.zeros(every + n + m)
        self.multipliers, self._values = memory[:every], memory[every:]
        self.x, self._row_values = self._values[:n], self._values[n:]
        self.point = memory[: every + n]
        self._box_multipliers, self._factors = self.point[:n], self.point[n:]
        self._signed = self.multipliers[: n + mi]
        # To the lower and to the upper bounds: distances, negative outside, and the multipliers.
        self._terms = np.zeros(2 * every + n)  # those distances, and the gradient
        self._distance, self._gradient = self._terms[:-n].reshape(2, every), self._terms[-n:]
        self._pull, self._zero = np.zeros((2, every)), np.zeros((2, every))
        self._below, self._above = self._distance
        self._down, self._up = self._pull[:, : n + mi]

    def load(self, qp: QP) -> None:
        """Take over the numbers of a QP of this size."""
        for place, numbers in zip(self._fields, qp[:9], strict=True):
            place[...] = numbers
        self._b[...] = qp.b

    def residuals(self) -> KktResiduals:
        """Return the residuals of ``x`` and ``multipliers``; 6 us at n = 35.

        References
        ----------
        Boyd & Vandenberghe, Convex Optimization, sec. 5.5.3, with two-sided rows and bounds.
        """
        distance, pull, gradient = self._distance, self._pull, self._gradient
        self._factors.dot(self._matrices, out=gradient)  # P is symmetric
        gradient += self.g
        self.rows.dot(self.x, out=self._row_values)
        np.subtract(self._values, self.lower, out=self._below)
        np.subtract(self.upper, self._values, out=self._above)
        outside = -distance.item(distance.argmin())  # NaN comes first, in half of min()'s time
        if np.vdot(self._signed, self._signed) == 0.0:  # no bound is active, as in most ticks
            np.abs(gradient, out=gradient)
            return KktResiduals(max(outside, 0.0), gradient.item(gradient.argmax()), 0.0)
        gradient += self._box_multipliers
        self._up[:] = self._signed
        np.negative(self._signed, out=self._down)
        np.maximum(pull, self._zero, out=pull)  # of a pair one: what the multiplier points at
        np.abs(self._terms, out=self._terms)
        clash = np.minimum(distance, pull, out=distance)
        return KktResiduals(
            max(outside, 0.0),  # NaN first: max(nan, a) is nan, but max(a, nan) is a
            gradient.item(gradient.argmax()),
            clash.item(clash.argmax()),
        )


class PerThread(threading.local):
    """Memory that each thread keeps, by the sizes of QPs."""

    def __init__(self) -> None:
        self.kept: dict[tuple[float, ...], Any] = {}

    def keep(self, key: tuple[float, ...], memory: Any) -> Any:
        """Keep and return ``memory``; all that was kept is let go when it has become too much."""
        if len(self.kept) >= MOST:
            self.kept.clear()
        self.kept[key] = memory
        return memory


_PER_THREAD = PerThread()


def kkt_residuals(qp: QP, x: Array, y: Array, z: Array, z_box: Array) -> KktResiduals:
    """Return the residuals of x (n,), y (me,), z (mi,), z_box (n,); infinite where one is too."""
    key = x.size, z.size, y.size
    stacked: Stacked | None = _PER_THREAD.kept.get(key)
    if stacked is None:
        stacked = _PER_THREAD.keep(key, Stacked(*key))
    point = np.concatenate((z_box, z, y, x), out=stacked.point)
    if np.vdot(point, point) > FARTHEST * FARTHEST:  # NaN is not, and stays
        return KktResiduals(math.inf, math.inf, math.inf)
    stacked.load(qp)
    return stacked.residuals()


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
    if math.inf in (r.primal, r.dual, r.complementarity):
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
        x, y, z, z_box = raw.x, raw.y, raw.z, raw.z_box
        residuals, eps = kkt_residuals(qp, x, y, z, z_box), self.eps
        if not (is_accurate(residuals, eps) or acceptable(residuals, eps, qp, x, y, z, z_box)):
            return None
        return self._solution(raw, Status.SOLVED, residuals, attempts)

    def refute(self, qp: QP, raw: RawSolution, attempts: int = 1) -> Solution | None:
        """Return the "infeasible" verdict, with the rows in conflict, when a certificate exists.

        A point that meets every row shows that the QP is feasible, and nothing is searched.
        """
        if not self.explain:
            return None
        residuals = self._residuals(qp, raw)
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
        return self._solution(raw, status, self._residuals(qp, raw), attempts)

    @staticmethod
    def _residuals(qp: QP, raw: RawSolution) -> KktResiduals:
        return kkt_residuals(qp, raw.x, raw.y, raw.z, raw.z_box)

    def _solution(
        self,
        raw: RawSolution,
        status: Status,
        residuals: KktResiduals,
        attempts: int,
        conflict: Conflict | None = None,
    ) -> Solution:
        return Solution(
            x=raw.x,
            y=raw.y,
            z=raw.z,
            z_box=raw.z_box,
            status=status,
            residuals=residuals,
            iterations=raw.iterations,
            solve_time=perf_counter() - self.started,
            solver=self.solver,
            conflict=conflict,
            attempts=attempts,
            message=raw.message,
        )
