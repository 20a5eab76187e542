"""From a solver's claim to a status that rests on evidence: the same check for every backend."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter

from wbc.qp.conflict import find_conflict
from wbc.qp.kkt import KktResiduals, acceptable, kkt_residuals
from wbc.qp.problem import QP
from wbc.qp.solution import Conflict, RawSolution, Solution, Status


@dataclass(frozen=True, slots=True)
class SolveCheck:
    """One call of a backend: which solver, what accuracy is promised, and when it started."""

    solver: str
    eps: float
    started: float  # perf_counter() at the call

    def accept(self, qp: QP, raw: RawSolution, attempts: int = 1) -> Solution | None:
        """Return the solution when its KKT residuals are small, else None."""
        residuals = self._residuals(qp, raw)
        if not acceptable(residuals, self.eps, qp, raw.x, raw.y, raw.z, raw.z_box):
            return None
        return self._solution(raw, Status.SOLVED, residuals, attempts)

    def refute(self, qp: QP, raw: RawSolution, attempts: int = 1) -> Solution | None:
        """Return the "infeasible" verdict, with the rows in conflict, when a certificate exists.

        A point that meets every row shows that the QP is feasible, and nothing is searched.
        """
        residuals = self._residuals(qp, raw)
        conflict = None if residuals.primal <= self.eps else find_conflict(qp)
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
            raw, status = replace(raw, message=message), Status.FAILED
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
