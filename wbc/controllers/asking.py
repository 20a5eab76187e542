"""Who solves the QPs of a tick: the backend that was chosen, in a hurry, or another.

Solvers that qpsolvers knows take a millisecond and more. In a tick with a budget they are asked
once, in few iterations, and only where the levels below have room beside that; DAQP answers what is
left. ``solution.solver`` says who answered.
"""

from __future__ import annotations

from collections.abc import Hashable

from wbc.controllers.work import ATTEMPT, Work, likely_work, work_of
from wbc.qp.backend import Backend
from wbc.qp.daqp import Daqp
from wbc.qp.problem import QP
from wbc.qp.solution import Solution


class Solvers:
    """A backend, and who is asked in its place.

    Parameters
    ----------
    quick:
        Whether solvers are always asked for one bounded attempt.
    """

    def __init__(self, backend: Backend, quick: bool = False) -> None:
        self._backend, self._quick = backend, quick
        patient = getattr(backend, "patient", False)  # backends of others need not say
        self._other = Daqp() if patient else None

    def solve(
        self, qp: QP, work: Work, workspace: Hashable, quick: bool = False, below: float = 0.0
    ) -> Solution:
        """Return the checked solution of ``qp``.

        Parameters
        ----------
        work:
            Of the tick; from half of its budget on, attempts are quick.
        workspace, quick:
            See :class:`wbc.qp.backend.Backend`.
        below:
            Units of work that the levels below take.
        """
        quick = quick or self._quick or work.short
        if self._other is not None and work.is_limited:
            return self._solve_patiently(self._other, qp, work, quick, below)
        if quick:
            solution = self._backend.solve(qp, workspace=workspace, quick=True)
        else:
            solution = self._backend.solve(qp, workspace=workspace)
        work.spent += work_of(solution)
        return solution

    def _solve_patiently(
        self, other: Daqp, qp: QP, work: Work, quick: bool, below: float
    ) -> Solution:
        """Ask the backend once while there is time, and then the other."""
        asked = not quick and work.has_room(likely_work(self._backend.name) + below)
        if asked:
            first = self._backend.solve(qp, quick=True)
            work.spent += work_of(first)
            if first.solved:
                return first
            work.spent += ATTEMPT
        solution = other.solve(qp, quick=quick or work.short)
        work.spent += work_of(solution)
        return solution._replace(attempts=2) if asked else solution
