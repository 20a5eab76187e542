"""Who solves the QPs of a tick: the backend that was chosen, in a hurry, or another.

Solvers that qpsolvers knows take a millisecond and more. In a tick with a budget they are asked
once, in few iterations, and only where the levels below have room beside that; DAQP answers what is
left. ``solution.solver`` says who answered.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Hashable
from functools import cache
from typing import Any

from wbc.controllers.slack import GivingQP
from wbc.controllers.work import likely_work, work_of
from wbc.qp.backend import Backend
from wbc.qp.daqp import Daqp
from wbc.qp.giving import solve_giving
from wbc.qp.problem import QP
from wbc.qp.proxqp import ProxQP
from wbc.qp.solution import Solution
from wbc.qp.work import Work, otherwise

# Of QPs with rows that give way: of 68,000 wild ticks none took more than 733.
ITERATIONS = 1000
# How far above eps their residuals may be. In 68,000 wild ticks one was above 1e-6, 3e-6: DAQP did
# not solve it in 250 ms, and joints were only brought to rest.
ENOUGH = 1000.0


@cache
def _takes_work(solve: Callable[..., Any]) -> bool:
    """Whether a backend's method counts the work of a tick; looked up once, in 50 us."""
    return "work" in inspect.signature(solve).parameters


class Solvers:
    """A backend, and who is asked in its place.

    Parameters
    ----------
    quick:
        Whether solvers are always asked for one bounded attempt.
    """

    def __init__(self, backend: Backend, quick: bool = False) -> None:
        self._backend, self._quick = backend, quick
        # Backends of others need not say whether they take their time, nor count what they do.
        patient = getattr(backend, "patient", False)
        self._counts = _takes_work(type(backend).solve)
        self._other = Daqp() if patient else None

    def solve(
        self, qp: QP, work: Work, workspace: Hashable, quick: bool = False, below: float = 0.0
    ) -> Solution:
        """Return the checked solution of ``qp``.

        Parameters
        ----------
        work:
            Of the tick; once most of its budget is spent, attempts are quick.
        workspace, quick:
            See :class:`wbc.qp.backend.Backend`.
        below:
            Units of work that the levels below take.
        """
        quick = quick or self._quick or work.short
        if self._other is not None and work.is_limited:
            return self._solve_patiently(self._other, qp, work, quick, below)
        options: dict[str, Any] = {"quick": True} if quick else {}
        if self._counts:
            options["work"] = work
        solution = self._backend.solve(qp, workspace=workspace, **options)
        if not self._counts:
            work.spent += work_of(solution)
        return solution

    def solve_giving(self, giving: GivingQP, work: Work) -> Solution:
        """Return the checked solution of a QP with its slacks as unknowns, asked for once.

        In place of DAQP, and of ProxQP, which asks DAQP once, the core answers without the slacks;
        where it does not, DAQP, once more with a finer zero: nobody is asked after that.
        """
        backend = self._backend
        ours = backend if isinstance(backend, Daqp | ProxQP) else None
        if ours is not None and giving.weights is not None:
            # Nearly solved will do: the other choice is a robot that is only brought to rest.
            found = solve_giving(giving.slackless, giving.weights, ENOUGH * ours.eps, ITERATIONS)
            if found is not None:
                work.spent += work_of(found)
                return found
        full = giving.qp
        solution = self.solve(full, work, None, quick=True)
        if ours is not None and not solution.solved:
            solution = Daqp(ours.eps, ITERATIONS).solve_finely(full, work) or solution
        return solution

    def _solve_patiently(
        self, other: Daqp, qp: QP, work: Work, quick: bool, below: float
    ) -> Solution:
        """Ask the backend once while there is time, and then the other."""
        likely = likely_work(self._backend.name) + otherwise(qp)
        asked = not quick and work.has_room(likely + below)
        if asked:
            first = self._backend.solve(qp, quick=True)
            work.spent += work_of(first)
            if first.solved:
                return first
        solution = other.solve(qp, quick=quick or work.short, work=work)
        return solution._replace(attempts=2) if asked else solution
