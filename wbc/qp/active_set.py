"""The core's own active-set method: fast, cold every time, with a certificate of infeasibility.

A dual active-set method for strictly convex QPs (Goldfarb & Idnani 1983; in the form of Arnstrom,
Bemporad & Axehall, IEEE Trans. Automatic Control 67(8), 2022) after eliminating the equality rows,
in one call of the core (native/source/active_set.c, reduce.c). If rows contradict each other, the
last active set gives a Farkas certificate (:mod:`wbc.qp.conflict`).

A soft row at the cost of 1/2 w s^2 has the slack s = z / w, z its multiplier: slacks are not
unknowns, so relaxed QPs are no larger than others.
"""

from __future__ import annotations

from collections.abc import Hashable
from time import perf_counter
from typing import Final

import numpy as np

from wbc.kinds import whole_number
from wbc.qp.conflict import FINEST, conflict_by_simplex, conflict_of, find_conflict
from wbc.qp.core import DONE, INFEASIBLE, CoreSolution, solve_in_core
from wbc.qp.kkt import SolveCheck, largest
from wbc.qp.problem import QP
from wbc.qp.solution import Conflict, KktResiduals, RawSolution, Solution, Status
from wbc.validate import Array, finite_number

NAME: Final = "active_set"
# Residuals of a last-resort solution may be this many times eps.
LAST_RESORT = 100.0
# Steps of the proximal-point method for costs that are not strictly convex, and its weight relative
# to the largest curvature: a step reduces the error by curvature / (curvature + weight).
_STEPS, _PROXIMAL = 30, 1e-6
_DIVERGED = 1e6  # primal residual from which on the proximal-point method is abandoned
NO_RESIDUALS = KktResiduals(np.inf, np.inf, np.inf)


class ActiveSet:
    """The core's active-set method, its solutions checked; without state between calls.

    ``eps``: accuracy promised, as in :class:`wbc.qp.proxqp.ProxQP`; ``max_iterations``: cap on
    changes of the active set.

    Raises InvalidInputError: eps or max_iterations out of range.
    """

    name: str = NAME

    def __init__(self, eps: float = 1e-8, max_iterations: int = 1000) -> None:
        self.eps, self.max_iterations = checked_settings(NAME, eps, max_iterations)

    def solve(self, qp: QP, workspace: Hashable = "default", quick: bool = False) -> Solution:
        """Return the checked solution of ``qp``; ``workspace`` is ignored.

        ``quick``: if there is none, no further search for the rows in conflict.

        Raises InvalidInputError: see :func:`wbc.qp.problem.check_qp`.
        """
        return self._solve(qp, None, perf_counter(), quick)

    def solve_soft(self, qp: QP, weights: Array, eps: float | None = None) -> Solution:
        """Return the checked solution of a QP in which rows may give way.

        Parameters
        ----------
        qp:
            Without slack variables.
        weights:
            (mi,) of 1/2 slack^2, infinite for hard rows.
        eps:
            Accuracy, if not the promised one; absolute then, however large the QP's numbers are.

        Returns
        -------
        Solution
            The slacks of the soft rows are appended to x, zeros to z_box.
        """
        give = np.ascontiguousarray(1.0 / weights)
        found = self._solve(qp, give, perf_counter(), True, eps)
        soft = np.isfinite(weights)
        slack = (give * found.z)[soft]
        x, z_box = (np.concatenate(both) for both in ((found.x, slack), (found.z_box, 0.0 * slack)))
        return found._replace(x=x, z_box=z_box)

    def answer(self, qp: QP) -> RawSolution:
        """Return the core's solution as an unchecked one: for benchmarks."""
        status, x, y, z, z_box, _, iterations = solve_in_core(qp, self.eps, self.max_iterations)
        if iterations < 0:
            claim = Status.INFEASIBLE if status == INFEASIBLE else Status.ITERATION_LIMIT
            return RawSolution.none(qp, claim, "")
        return RawSolution(x, y, z, z_box, Status.SOLVED, iterations)

    def _solve(
        self, qp: QP, give: Array | None, start: float, quick: bool, eps: float | None = None
    ) -> Solution:
        absolute, eps = eps is not None, self.eps if eps is None else eps
        found = solve_in_core(qp, eps, self.max_iterations, give)
        if found.status == DONE:
            return _solution(found, Status.SOLVED, start)
        if found.status == INFEASIBLE:
            conflict = conflict_of(qp, found.y, found.z, found.z_box)
            if conflict is not None:
                nowhere = found._replace(x=np.full(qp.g.size, np.nan), residuals=NO_RESIDUALS)
                return _solution(nowhere, Status.INFEASIBLE, start, conflict)
        conflict = None
        if not absolute:
            check = SolveCheck(NAME, eps, start, explain=False)
            raw, solution = None, None
            if found.iterations >= 0:  # else nothing was written: what the memory held
                raw = RawSolution(*found[1:5], Status.SOLVED, found.iterations)
                # Relative to the QP's numbers it may be accurate.
                solution = check.accept(_given_way(qp, give, raw), raw)
            if solution is not None:
                return solution
            conflict = None if quick else find_conflict(qp)
            solution = None if conflict else self._less_accurate(qp, give, check, raw)
            if solution is not None:
                return solution
            if conflict is None and not quick:  # infeasible by less than the default tolerance
                conflict = conflict_by_simplex(qp, FINEST)
        claim = Status.FAILED if conflict is None else Status.INFEASIBLE
        message = "" if conflict else "no answer whose residuals are small, and no proof of none"
        none = RawSolution.none(qp, claim, message)
        return Solution(
            *none[:4], claim, NO_RESIDUALS, 0, perf_counter() - start, NAME, conflict, 1, message
        )

    def _less_accurate(
        self, qp: QP, give: Array | None, check: SolveCheck, raw: RawSolution | None
    ) -> Solution | None:
        """Return a last resort: the proximal-point solution, or one with residuals above eps."""
        near = proximal(qp, self.eps, self.max_iterations, give)
        solution = None if near is None else check.accept(_given_way(qp, give, near), near)
        nearly = check._replace(eps=LAST_RESORT * check.eps)
        for last in (raw, near):
            if solution is None and last is not None:
                solution = nearly.accept(_given_way(qp, give, last), last)
        return solution


def _given_way(qp: QP, give: Array | None, raw: RawSolution) -> QP:
    """Return the QP of hard rows with the same solution: soft rows end where they gave way to."""
    return qp if give is None else qp._replace(l=qp.l + give * raw.z, u=qp.u + give * raw.z)


def proximal(
    qp: QP, eps: float, max_iterations: int, give: Array | None = None
) -> RawSolution | None:
    """Return the solution of a QP whose cost is convex, but not strictly; None: none was found.

    The proximal-point method (Rockafellar 1976): each step is a QP with a little curvature about
    the point of the last one.
    """
    n = qp.g.size
    weight = _PROXIMAL * max(largest(qp.P.diagonal()), 1.0)
    x: Array = np.clip(np.zeros(n), qp.lower, qp.upper)
    steps = 0
    curved = qp._replace(P=qp.P + weight * np.eye(n))
    raw = None
    for _ in range(_STEPS):
        found = solve_in_core(curved._replace(g=qp.g - weight * x), eps, max_iterations, give)
        if found.iterations < 0 or not found.residuals.primal < _DIVERGED:
            return raw
        steps += found.iterations
        moved = weight * largest(found.x - x)
        x = found.x
        raw = RawSolution(x, found.y, found.z, found.z_box, Status.SOLVED, steps)
        if moved <= 0.1 * eps:
            break
    return raw


def _solution(
    found: CoreSolution, status: Status, start: float, conflict: Conflict | None = None
) -> Solution:
    point, spent = (found.x, found.y, found.z, found.z_box), perf_counter() - start
    iterations = max(found.iterations, 0)
    return Solution(*point, status, found.residuals, iterations, spent, NAME, conflict)


def checked_settings(solver: str, eps: float, max_iterations: int) -> tuple[float, int]:
    """Return the accuracy that a solver promises, and its cap on iterations, both in range."""
    return (
        finite_number(f"eps of {solver}", eps, least=1e-12),
        whole_number(f"max_iterations of {solver}", max_iterations, least=1, most=1e9),
    )
