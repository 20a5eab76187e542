"""The default backend: ProxQP kept warm between ticks, one workspace per contact set."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import replace
from time import perf_counter

from wbc.qp.kkt import SolveCheck
from wbc.qp.native import Workspace
from wbc.qp.polish import polish
from wbc.qp.problem import QP, check_qp
from wbc.qp.solution import RawSolution, Solution
from wbc.validate import finite_number

# How far above eps the residuals of a last resort may be.
NEARLY = 100.0
# How many times longer the last attempt may take: a QP in 60,000 needed 200 to 800 rounds.
PATIENCE = 20


class ProxQP:
    """ProxQP's dense solver, its solutions checked, its failures retried.

    Policy: (1) solve warm from the last tick; (2) if our KKT residuals reject that, look for rows
    in conflict, and if there are none solve cold in a new workspace; (3) if they reject that too,
    settle the active set by a few exact steps (:mod:`wbc.qp.polish`); (4) accept a solution within
    100 eps: a robot that stands still for want of 1e-7 rad/s is worse off, and the residuals tell;
    (5) solve for up to twenty times as long (some milliseconds); (6) return a status that says what
    was found. The workspace of a failed tick is dropped, so a failure cannot affect the next tick.
    The warm start is the only memory between calls.

    Parameters
    ----------
    eps:
        Accuracy: a solution is accepted when every KKT residual is below eps (1 + the largest term
        it is made of); about one tick in a thousand with active limits everywhere needs step (4).
    max_iterations:
        Cap on ProxQP's outer iterations, per attempt but the last. Ticks take 2-10; of 2870 cold
        solves none needed more than 30. A higher cap only prolongs infeasible ticks.
    warm:
        False: every solve is cold, as a stateless solver would be.

    Raises
    ------
    InvalidInputError
        eps or max_iterations out of range.
    """

    def __init__(self, eps: float = 1e-8, max_iterations: int = 50, warm: bool = True) -> None:
        self.name = "proxqp" if warm else "proxqp_cold"
        self.eps = finite_number("eps of ProxQP", eps, least=1e-12)
        self.max_iterations = int(
            finite_number("max_iterations of ProxQP", max_iterations, least=1)
        )
        self.warm = warm
        self._workspaces: dict[Hashable, Workspace] = {}

    def solve(self, qp: QP, workspace: Hashable = "default") -> Solution:
        """Return the checked solution of ``qp``; 70-80 us at n = 35 on a smooth tick.

        Parameters
        ----------
        workspace:
            Names the contact set. QPs of the same name and sizes share a warm start, so two
            contact sets of equal size need two names.

        Raises
        ------
        InvalidInputError
            See :func:`wbc.qp.problem.check_qp`.
        """
        check = SolveCheck(self.name, self.eps, perf_counter())
        check_qp(qp)
        key = (workspace, qp.g.size, qp.b.size, qp.u.size)
        attempts = 1
        last = self._workspaces.pop(key, None)
        if last is not None:
            raw = last.solve_warm(qp)
            accepted = check.accept(qp, raw)
            if accepted is not None:
                self._workspaces[key] = last
                return accepted
            # On an infeasible QP the search takes a fifth of the time of a cold attempt.
            refuted = check.refute(qp, raw)
            if refuted is not None:
                return refuted
            attempts = 2
        fresh = Workspace.create(qp, self.eps, self.max_iterations)
        raw = fresh.solve_cold()
        solution = check.accept(qp, raw, attempts) or check.refute(qp, raw, attempts)
        if solution is None:
            solution = self._retry(qp, check, raw, attempts)
        if self.warm and solution.solved:
            self._workspaces[key] = fresh
        return solution

    def _retry(self, qp: QP, check: SolveCheck, raw: RawSolution, attempts: int) -> Solution:
        """Polish a solution, accept it if it is nearly good enough, or solve for much longer."""
        polished = polish(qp, raw)
        nearly = replace(check, eps=NEARLY * self.eps)
        solution = check.accept(qp, polished, attempts + 1)
        solution = solution or nearly.accept(qp, raw, attempts + 1)
        if solution is not None:
            return solution
        longer = Workspace.create(qp, self.eps, PATIENCE * self.max_iterations).solve_cold()
        solution = check.accept(qp, longer, attempts + 2)
        return solution or check.judge(qp, polished, attempts + 2)
