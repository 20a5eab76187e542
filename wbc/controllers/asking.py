"""Who solves the QPs of a tick: the backend that was chosen, or, where that fails, the core."""

from __future__ import annotations

import logging
from collections.abc import Hashable
from typing import Any

from wbc.controllers.slack import GivingQP
from wbc.qp.active_set import ActiveSet
from wbc.qp.backend import Backend
from wbc.qp.problem import QP
from wbc.qp.proxqp import ProxQP
from wbc.qp.solution import Solution, Status

# How far above eps the residuals of a relaxed QP may be: the other choice is a robot that is only
# brought to rest.
ENOUGH = 1000.0


class Solvers:
    """A backend, and who is asked where it gives no answer.

    Parameters
    ----------
    quick:
        Whether solvers are always asked for one bounded attempt.
    """

    def __init__(self, backend: Backend, quick: bool = False) -> None:
        self._backend, self._quick = backend, quick
        eps = backend.eps if isinstance(backend, ActiveSet | ProxQP) else 1e-8
        self._core = ActiveSet(eps)
        self._own = isinstance(backend, ActiveSet | ProxQP)
        self._told = False

    def solve(self, qp: QP, workspace: Hashable, quick: bool = False) -> Solution:
        """Return the checked solution of ``qp``; see :class:`wbc.qp.backend.Backend`.

        ``Solution.solver`` says who answered, and a log when it was the core for the first time.
        """
        options: dict[str, Any] = {"quick": True} if quick or self._quick else {}
        solution = self._backend.solve(qp, workspace=workspace, **options)
        if self._own or solution.solved or solution.status is Status.INFEASIBLE:
            return solution
        exact = self._core.solve(qp, quick=quick or self._quick)
        if exact.solved and not self._told:
            self._told = True
            logging.getLogger(__name__).warning(
                "QP solver %r left a QP unsolved (%s); %r answered, as it will others",
                self._backend.name,
                solution.message or solution.status,
                exact.solver,
            )
        spent = solution.solve_time + exact.solve_time
        return exact._replace(attempts=solution.attempts + 1, solve_time=spent)

    def solve_giving(self, giving: GivingQP) -> Solution:
        """Return the checked solution of a QP with its slacks behind the unknowns."""
        if giving.weights is None:
            return self.solve(giving.qp, None, quick=True)
        return self._core.solve_soft(giving.slackless, giving.weights, ENOUGH * self._core.eps)
