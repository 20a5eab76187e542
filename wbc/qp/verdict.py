"""From what a solver says to what the evidence says: the same judgement for every backend."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

from wbc.qp.answer import Answer
from wbc.qp.conflict import find_conflict
from wbc.qp.kkt import KktResiduals, acceptable, kkt_residuals
from wbc.qp.problem import QP
from wbc.qp.solution import Conflict, Solution, Status


@dataclass(frozen=True, slots=True)
class Trial:
    """One call of a backend: which solver, what accuracy is promised, and since when it runs."""

    solver: str
    eps: float
    started: float  # perf_counter() at the call

    def accept(self, qp: QP, answer: Answer, attempts: int = 1) -> Solution | None:
        """Return the solution when its KKT residuals are small, else None."""
        residuals = self._residuals(qp, answer)
        if not acceptable(residuals, self.eps, qp, answer.x, answer.y, answer.z, answer.z_box):
            return None
        return self._solution(answer, Status.SOLVED, residuals, attempts, None)

    def refute(self, qp: QP, answer: Answer, attempts: int = 1) -> Solution | None:
        """Return the "infeasible" verdict, with the rows in conflict, when a certificate exists.

        An answer that meets every row shows that the QP is feasible, and nothing is searched.
        """
        residuals = self._residuals(qp, answer)
        conflict = None if residuals.primal <= self.eps else find_conflict(qp)
        if conflict is None:
            return None
        return self._solution(answer, Status.INFEASIBLE, residuals, attempts, conflict)

    def judge(self, qp: QP, answer: Answer, attempts: int = 1) -> Solution:
        """Return the final verdict: accepted, refuted, or the status that is left.

        A solver that claims a result for which there is no evidence is contradicted; otherwise
        its own word stands.
        """
        settled = self.accept(qp, answer, attempts) or self.refute(qp, answer, attempts)
        if settled is not None:
            return settled
        unfounded = answer.claim in (Status.SOLVED, Status.INFEASIBLE)
        status = Status.CONTRADICTED if unfounded else answer.claim
        return self._solution(answer, status, self._residuals(qp, answer), attempts, None)

    @staticmethod
    def _residuals(qp: QP, answer: Answer) -> KktResiduals:
        return kkt_residuals(qp, answer.x, answer.y, answer.z, answer.z_box)

    def _solution(
        self,
        answer: Answer,
        status: Status,
        residuals: KktResiduals,
        attempts: int,
        conflict: Conflict | None,
    ) -> Solution:
        return Solution(
            x=answer.x,
            y=answer.y,
            z=answer.z,
            z_box=answer.z_box,
            status=status,
            residuals=residuals,
            iterations=answer.iterations,
            solve_time=perf_counter() - self.started,
            solver=self.solver,
            conflict=conflict,
            attempts=attempts,
            message=answer.message,
        )
