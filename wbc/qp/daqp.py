"""DAQP called directly: the fastest backend at controller sizes, cold every time.

A dual active-set method (Arnstrom, Bemporad & Axehall, IEEE Trans. Automatic Control 67(8), 2022).
Measured at n = 35 with 12 equality rows and a box: 19 us in ``daqp.solve``, 30 us through
qpsolvers; with 25 two-sided rows 29 and 42 us. A kept ``daqp.Model`` saves 3 us more and was not
worth a memory between ticks. Rows and bounds pass as they are, two-sided, in DAQP's own order.
An answer whose residuals are small is evidence for itself; what else a QP is checked for is looked
at when they are not.
"""

from __future__ import annotations

from collections.abc import Hashable
from functools import cached_property
from time import perf_counter
from typing import Any

import daqp
import numpy as np
from numpy.typing import NDArray

from wbc.qp.daqp_memory import EQUALITY, daqp_memory
from wbc.qp.kkt import SolveCheck, Stacked
from wbc.qp.native_daqp import NativeDaqp, native_daqp
from wbc.qp.problem import QP, check_qp, is_sound
from wbc.qp.solution import RawSolution, Solution, Status
from wbc.qp.work import ACTIVE_SET, FEWEST, Work
from wbc.validate import Array, finite_number

ENDLESS = 1e100  # multipliers beyond are none
NOT_ASKED = "not asked: the budget of work is spent"
# Cap on iterations of who is in a hurry: of 3128 QPs solved in ticks from wild states none took
# more than 393, and those on which DAQP cycles took all 1000, three times.
QUICK_ITERATIONS = 500
# DAQP's exit flags; a dependent working set (-6) is how it sees contradictory equalities.
_CLAIMS = {
    1: (Status.SOLVED, ""),
    -1: (Status.INFEASIBLE, "infeasible"),
    -2: (Status.FAILED, "the active set cycles"),
    -3: (Status.FAILED, "unbounded"),
    -4: (Status.ITERATION_LIMIT, "iteration limit"),
    -5: (Status.FAILED, "P is not positive semidefinite"),
    -6: (Status.INFEASIBLE, "the equality rows contradict each other"),
}


def checked_settings(solver: str, eps: float, max_iterations: int) -> tuple[float, int]:
    """Return the accuracy that a solver promises, and its cap on iterations, both in range."""
    return (
        finite_number(f"eps of {solver}", eps, least=1e-12),
        int(finite_number(f"max_iterations of {solver}", max_iterations, least=1)),
    )


class Daqp:
    """DAQP, its answers checked; nothing is kept between calls.

    Parameters
    ----------
    eps:
        Accuracy promised, as in :class:`wbc.qp.proxqp.ProxQP`.
    max_iterations:
        Cap on changes of the active set.

    Raises
    ------
    InvalidInputError
        eps or max_iterations out of range.
    """

    name = "daqp"

    def __init__(self, eps: float = 1e-8, max_iterations: int = 1000) -> None:
        self.eps, self.max_iterations = checked_settings("DAQP", eps, max_iterations)

    @cached_property
    def _native(self) -> NativeDaqp | None:
        return native_daqp(self.eps, self.max_iterations)

    def solve(
        self,
        qp: QP,
        workspace: Hashable = "default",
        quick: bool = False,
        work: Work | None = None,
    ) -> Solution:
        """Return the checked solution of ``qp``; ``workspace`` is ignored.

        ``quick``: in fewer iterations; if there is none, neither try a finer zero nor search for
        the rows in conflict.
        ``work``: of the tick; the core's attempt gets a third of what is left, and each after it
        half of the rest.

        Raises
        ------
        InvalidInputError
            See :func:`wbc.qp.problem.check_qp`.
        """
        work = Work() if work is None else work
        check = SolveCheck(self.name, self.eps, perf_counter(), not quick, work)
        answer, ours = None, type(self).answer is Daqp.answer
        if ours:  # who derives from this may answer otherwise
            found = self.solve_natively(qp, work, quick)
            if found is not None:
                return found
            most = self._afforded(qp, work, quick=quick) if is_sound(qp, shapes_only=True) else 0
            if most:
                memory = daqp_memory(qp, self.eps)
                if memory.stacked.is_finite():
                    answer = memory.solve(most)
                    work.spent += ACTIVE_SET.units(qp, answer.iterations)
                    found = check.certify(memory.stacked, *answer[:3])
                    if found is not None:
                        return found
        check_qp(qp)
        if answer is None:  # theirs, or there is nothing to solve, or no time for it
            return check.judge(qp, self.answer(qp, work) if ours else self.answer(qp))
        raw = _raw(qp, *answer)
        settled = None
        if not quick:
            settled = check.accept(qp, raw) or check.accept(qp, self.finer(qp, work), 2)
        return settled or check.judge(qp, raw)

    def solve_natively(self, qp: QP, work: Work, quick: bool = False) -> Solution | None:
        """Return what the core settles, if anything."""
        native = self._native
        if native is None:
            return None
        most = self._afforded(qp, work, 1.0 / 3.0, quick)
        return native.solve(qp, self.name, quick, work, most) if most else None

    def solve_finely(self, qp: QP, work: Work | None = None) -> Solution | None:
        """Return the checked solution by a finer zero, or None; ``work``: of the tick."""
        check = SolveCheck(self.name, self.eps, perf_counter())
        return check.accept(qp, self.finer(qp, work))

    def answer(self, qp: QP, work: Work | None = None) -> RawSolution:
        """Return DAQP's answer, unchecked; ``work``: of the tick, half of what is left for this."""
        return self._answer(qp, work, fine=False)

    def finer(self, qp: QP, work: Work | None = None) -> RawSolution:
        """Return the same with a finer zero: see :data:`wbc.qp.daqp_direct.FINE`."""
        return self._answer(qp, work, fine=True)

    @property
    def quick_iterations(self) -> int:
        """Cap on the iterations of a quick attempt."""
        return min(self.max_iterations, QUICK_ITERATIONS)

    def _afforded(self, qp: QP, work: Work, part: float = 0.5, quick: bool = False) -> int:
        """Return how many iterations an attempt may take, of so much of what is left."""
        most = self.quick_iterations if quick else self.max_iterations
        return ACTIVE_SET.afforded(qp, part * work.left, most, FEWEST)

    def _answer(self, qp: QP, work: Work | None, fine: bool) -> RawSolution:
        work = Work() if work is None else work
        most = self._afforded(qp, work)
        if not most:
            return RawSolution.none(qp, Status.FAILED, NOT_ASKED)
        answer = daqp_memory(qp, self.eps, fine).solve(most)
        work.spent += ACTIVE_SET.units(qp, answer.iterations)
        return _raw(qp, *answer)


class KeptDaqp:
    """DAQP's model kept from QP to QP, with its memory and active set: what wbc bench compares.

    An active set may be no start for another QP: DAQP then claims to have solved it, in NaN, and
    so from then on. What a kept model does not solve is asked of a new one within the same call,
    and only a model whose last answer was solved is kept.

    See :class:`Daqp` for the parameters. Residuals are not checked.
    """

    def __init__(self, eps: float, max_iterations: int = 1000) -> None:
        self.eps, self.max_iterations = eps, max_iterations
        self._sizes: tuple[int, ...] = ()
        self._model: Any = None

    def answer(self, qp: QP) -> RawSolution:
        """Return DAQP's answer; it is finite if it claims to be solved."""
        sizes = (qp.g.size, qp.b.size, qp.u.size)
        raw = None
        if sizes == self._sizes:
            raw = self._asked(qp, self._model.update(*_data(qp)[:-1]))
        if raw is None or raw.claim is not Status.SOLVED:
            self._model = daqp.Model()
            limits = {"primal_tol": 0.1 * self.eps, "iter_limit": self.max_iterations}
            self._model.settings = {**self._model.settings, **limits}
            raw = self._asked(qp, self._model.setup(*_data(qp))[0])
        self._sizes = sizes if raw.claim is Status.SOLVED else ()
        return raw

    def _asked(self, qp: QP, flag: int) -> RawSolution:
        """Return the model's answer, after it was given ``qp`` and said ``flag``."""
        if flag < 0:
            return RawSolution.none(qp, *_CLAIMS.get(flag, (Status.FAILED, f"exit flag {flag}")))
        x, _, flag, info = self._model.solve()
        return _raw(qp, x, info["lam"], info["iterations"], flag)


def _data(qp: QP) -> tuple[Array | NDArray[np.intc], ...]:
    """Return a QP as DAQP takes it: bounds, inequality rows, equality rows."""
    stacked = Stacked(qp.g.size, qp.u.size, qp.b.size)
    stacked.load(qp)
    sense = np.zeros(stacked.upper.size, dtype=np.intc)
    sense[stacked.inequalities :] = EQUALITY
    return stacked.P, stacked.g, stacked.rows, stacked.upper, stacked.lower, sense


def _raw(qp: QP, x: Array, multipliers: Array, iterations: int, flag: int) -> RawSolution:
    """Return an answer of DAQP in our form."""
    n = qp.g.size
    equalities = n + qp.u.size
    claim, message = _CLAIMS.get(flag, (Status.FAILED, f"exit flag {flag}"))
    # It grows multipliers without end on infeasible QPs: to NaN, or to what overflows in a product.
    if not (np.abs(multipliers).max(initial=0.0) < ENDLESS and np.isfinite(x).all()):
        if claim is Status.SOLVED:
            claim, message = Status.FAILED, "claimed 'solved', with numbers that are not finite"
        return RawSolution.none(qp, claim, message)
    return RawSolution(
        x=x,
        y=multipliers[equalities:],
        z=multipliers[n:equalities],
        z_box=multipliers[:n],
        claim=claim,
        iterations=iterations,
        message=message,
    )
