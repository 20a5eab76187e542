"""What a tick may do: work is counted, never clocked, so that the same input gives the same bits.

A unit is about a microsecond of a quiet core; what steps take is estimated by sizes and iterations.
Where a budget does not afford a step, the tick goes on with the cheapest checked answer there is:

* rows of margins are cut, and levels of lower priority solved, only while the budget affords them:
  the levels above have an answer within limits, contacts and margins already;
* solvers get as many iterations as what is left affords (:mod:`wbc.qp.work`); once most of the
  budget is spent they are asked for one attempt, and slow ones are not asked
  (:mod:`wbc.controllers.asking`);
* a step that leads inside a margin is scaled down by fewer looks, or to rest.

What was left out is said by name, in :attr:`wbc.controllers.tick.Tick.left_out`.
"""

from __future__ import annotations

import math

from wbc.qp.solution import Solution
from wbc.validate import finite_number

USUAL = "usual"
# The usual budget: with what goes beyond it 3 ms of a quiet core, 5 of one with busy neighbours; or
# so many times what it takes to solve each level once, where that is more: of a tick that goes as
# it should nothing is left out.
_LEAST, _ROOM = 2400.0, 1.5
# Solvers: what a call takes, and each iteration.
_SOLVERS = {
    "proxqp": (80.0, 35.0),
    "proxqp_cold": (250.0, 35.0),
    "daqp": (60.0, 4.0),
    "active_set": (150.0, 3.0),
    "piqp": (400.0, 15.0),
    "osqp": (1500.0, 2.5),
}
_OTHERS = 1300.0, 0.0  # they do not say how many iterations they took
# An attempt that was not accepted, and a search for rows in conflict.
_ATTEMPT, _CONFLICT = 700.0, 600.0


def work_of(solution: Solution) -> float:
    """Return what a solution took."""
    call, iteration = _SOLVERS.get(solution.solver, _OTHERS)
    work = call + iteration * solution.iterations + _ATTEMPT * (solution.attempts - 1)
    return work if solution.conflict is None else work + _CONFLICT


def units_of(budget: float | str | None, once: float) -> float:
    """Return the units of a budget as users give it; ``once``: what solving each level once takes.

    Raises
    ------
    InvalidInputError
        Neither a number above zero, nor None, nor ``"usual"``.
    """
    if budget is None:
        return math.inf
    if isinstance(budget, str) and budget == USUAL:
        return max(_LEAST, _ROOM * once)
    return finite_number('controller, budget (units, "usual" or None)', budget, above=0.0)


def likely_work(solver: str) -> float:
    """Return what a call of a solver mostly takes."""
    call, iteration = _SOLVERS.get(solver, _OTHERS)
    return call + 20.0 * iteration
