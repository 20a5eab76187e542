"""The default backend: ProxQP kept warm between ticks, one workspace per contact set."""

from __future__ import annotations

from collections.abc import Hashable
from math import inf
from time import perf_counter
from typing import NamedTuple

import numpy as np

from wbc.qp.daqp import NOT_ASKED, Daqp, checked_settings
from wbc.qp.judge import Answered, Judge
from wbc.qp.kkt import SolveCheck
from wbc.qp.native import Workspace
from wbc.qp.pause import Pauses
from wbc.qp.polish import polish
from wbc.qp.problem import QP, check_qp, is_sound
from wbc.qp.solution import RawSolution, Solution, Status
from wbc.qp.work import COLD, INNER, POLISH, WARM, Steps, Work, otherwise

# How far above eps the residuals of a last resort may be.
NEARLY = 100.0
# Cap on DAQP's iterations: of 400 QPs that needed it one took 244, where it cycles it takes all.
ACTIVE_SET_ITERATIONS = 300
# The same for QPs that come once and are asked for nowhere else: relaxed ones of 120 unknowns took
# up to 996 in 10,000 ticks from wild states, and a few all.
ONE_OFF_ITERATIONS = 1000
# Cap on the outer iterations of warm solves: most take 1 to 3, and 20 took up to 49 ms. Cold ones
# keep theirs: with 12 every hundredth ordinary QP would be left to the active-set method.
WARM_ITERATIONS = 8
# Of cold ones of QPs whose solution is known already: all 20 took up to 18 ms.
COLD_ITERATIONS = 10
# Of warm ones of who is in a hurry and knows what to do instead: of 470 accepted in ticks from wild
# states none needed more, and those that were not accepted took 8 ms to come to 8.
QUICK_WARM_ITERATIONS = 5
# Iterations of the active-set method beyond which ProxQP is not asked from nothing as well: that
# took 7 ms more in ticks from wild states; those of pushes that are survived took up to 116. In a
# hurry fewer: from nothing ProxQP took up to 12 ms for what was beyond.
HARD, QUICK_HARD = 120, 32
# rho where the equalities are eliminated: one step is enough where no bound is active, 5 us less
# than with Workspace's own; of 3000 QPs with active ones 47 were not solved, 43 with that.
REDUCED_RHO = 1e-8

Key = tuple[Hashable, int, int, int]  # of a warm start: name and sizes


class _Attempt(NamedTuple):
    """What ProxQP answered, what is accepted of it, and whether it started from nothing."""

    accepted: Solution | None
    raw: RawSolution
    cold: bool

    @property
    def capped(self) -> bool:
        """Whether it ran into its cap of iterations."""
        return self.raw.claim is Status.ITERATION_LIMIT


class ProxQP:
    """ProxQP's dense solver, its solutions checked, its failures retried.

    Policy: (1) solve in few iterations warm from the last tick, or cold; (2) if our KKT residuals
    reject that, solve by an active-set method (DAQP, 0.1 to 0.4 ms), once more with a finer zero
    if need be: weights over many decades stall ProxQP; (3) look for rows in conflict; (4) if there
    are none settle the active set of DAQP's point by a few exact steps (:mod:`wbc.qp.polish`), or
    accept a solution within 100 eps: a robot that stands still for want of 1e-7 rad/s is worse off,
    and the residuals tell; (5) accept what ProxQP comes to from nothing, after (4) if DAQP gave no
    point; (6) return a status that says what was found. The workspace of a failed tick is dropped,
    so a failure cannot affect the next tick.
    Where ProxQP ran into its cap, the next QPs of that name go to the active-set method first, then
    to step (3) if it calls them infeasible: what stalls once, stalls in every tick, for a
    millisecond each. ProxQP is asked again once both fail (not if ``quick``), and after a while:
    100 QPs, and twice as many after every stall. QPs that will not come again always go there
    first. Between calls nothing is kept but that and the warm start. ``Solution.solver`` says who
    answered.

    Parameters
    ----------
    eps:
        Accuracy: a solution is accepted when every KKT residual is below eps (1 + the largest term
        it is made of); about one tick in a thousand with active limits everywhere needs step (4).
    max_iterations:
        Cap on ProxQP's outer iterations, per cold attempt. Ticks take 2-10; of 2870 cold solves
        none needed more than 30. A higher cap only prolongs infeasible ticks.
    warm:
        False: every solve is cold, as a stateless solver would be.

    Raises
    ------
    InvalidInputError
        eps or max_iterations out of range.
    """

    def __init__(self, eps: float = 1e-8, max_iterations: int = 20, warm: bool = True) -> None:
        self.name = "proxqp" if warm else "proxqp_cold"
        self.eps, self.max_iterations = checked_settings("ProxQP", eps, max_iterations)
        self.warm = warm
        self.active_set = Daqp(self.eps, ACTIVE_SET_ITERATIONS)
        self._one_off = Daqp(self.eps, ONE_OFF_ITERATIONS)
        self._workspaces: dict[Hashable, Workspace] = {}
        self._pauses = Pauses()

    def __getstate__(self) -> dict[str, object]:
        """Leave warm starts out: a copied workspace of ProxQP 0.8 has lost its box."""
        return {**self.__dict__, "_workspaces": {}}

    def solve(
        self,
        qp: QP,
        workspace: Hashable = "default",
        quick: bool = False,
        work: Work | None = None,
    ) -> Solution:
        """Return the checked solution of ``qp``; 70-80 us at n = 35 on a smooth tick.

        Parameters
        ----------
        workspace:
            Names the contact set. QPs of the same name and sizes share a warm start, so two
            contact sets of equal size need two names. None: a QP that will not come again; the
            active-set method is asked first, which starts from nothing in a third of the time.
        quick:
            Give up after step (2), without the finer zero, without a search for the rows in
            conflict, and before ProxQP is asked from nothing for what has no solution: for who
            knows what to do instead, in bounded time.
        work:
            Of the tick: iterations are bounded by what is left of it, and steps that it does not
            afford are left out.

        Raises
        ------
        InvalidInputError
            See :func:`wbc.qp.problem.check_qp`.
        """
        work = Work() if work is None else work
        check = SolveCheck(self.name, self.eps, perf_counter(), not quick, work)
        key = workspace, qp.g.size, qp.b.size, qp.u.size
        paused = bool(self._pauses) and self._pauses.goes_on(workspace)
        warm = key in self._workspaces and not paused
        if not (warm and is_sound(qp)):  # else the bounds are judged with the answer
            check_qp(qp)
        once = workspace is None
        if once and quick:
            return self._solve_once(qp, check, work)
        if quick:
            return self._solve_quickly(qp, check, key, paused, work)
        exact = None
        if paused or once:
            attempts, by = 1 if once else 2, check._replace(solver=Daqp.name)
            exact, settled = self._ask_actively(qp, by, attempts, work)
            if settled is None and exact.claim is Status.INFEASIBLE:
                settled = by.refute(qp, exact, attempts)
                check = check._replace(explain=False)  # none was found, and none will be
            if settled is not None:
                return settled
        attempt = self._attempt(qp, check, key, work)
        if attempt.accepted is not None:
            return attempt.accepted
        if attempt.capped:
            self._pause(workspace)
        return self._retry(qp, check, attempt, exact, work)

    def solve_for(self, judge: Judge, qp: QP, workspace: Hashable, quick: bool) -> Answered | None:
        """Solve a QP without equalities for who judges the answer; None: there is none.

        In few iterations, warm from the last tick; what is rejected, and all while ProxQP is left
        in peace, by the active-set method, which is also asked first where there is no warm start.
        What neither solves is to be asked of :meth:`solve`; for ``quick`` see there.
        """
        warm, cold = (
            (QUICK_WARM_ITERATIONS, COLD_ITERATIONS)
            if quick
            else (WARM_ITERATIONS, self.max_iterations)
        )
        key = workspace, qp.g.size, 0, qp.u.size
        paused = bool(self._pauses) and self._pauses.goes_on(workspace)
        if quick and not paused:
            self._forget_if_far(key, qp)
        last = None if paused else self._workspaces.pop(key, None)
        if last is None:
            if not judge.solves():
                return None
            if paused or judge.iterations > (QUICK_HARD if quick else HARD):
                return Answered(Daqp.name, 1)
            cap = min(cold, self.max_iterations)
            native = Workspace.create(qp, self.eps, cap, default_rho=REDUCED_RHO)
            native.solve_cold()
        else:
            native = last
            native.run(qp)
        results, attempts = native.native.results, 1 if last else 2
        x, z, info = results.x.tobytes(), results.z.tobytes(), results.info
        if judge.takes(x, z, native.scale, info.iter):
            self._workspaces[key] = native
            if last is None:
                native.cap(min(warm, self.max_iterations))
            return Answered(self.name, attempts)
        if not judge.solves():
            return None
        if native.is_capped:
            self._pause(workspace)
        return Answered(Daqp.name, attempts + 1)

    def _forget_if_far(self, key: Key, qp: QP) -> None:
        """In a hurry: drop a warm start that is hardly one."""
        last = self._workspaces.get(key)
        if last is not None and last.is_far(qp):
            del self._workspaces[key]

    def _pause(self, workspace: Hashable) -> None:
        """Leave ProxQP in peace with QPs of that name for a while."""
        if self.warm and workspace is not None:
            self._pauses.begin(workspace)

    def _solve_quickly(
        self, qp: QP, check: SolveCheck, key: Key, paused: bool, work: Work
    ) -> Solution:
        """Solve in bounded time.

        A QP without solution takes ProxQP 15 to 20 ms from nothing, and the active-set method half
        a millisecond: where there is no warm start it is asked first whether there is one.
        """
        workspace, *_ = key
        exact = None
        self._forget_if_far(key, qp)
        if paused or key not in self._workspaces:
            exact = self._solve_actively(qp, check, self.active_set, work)
            if paused or not exact.solved or exact.iterations > QUICK_HARD:
                return exact
        attempt = self._attempt(qp, check, key, work, COLD_ITERATIONS, QUICK_WARM_ITERATIONS)
        if attempt.accepted is not None:
            return attempt.accepted
        exact = exact or self._solve_actively(qp, check, self.active_set, work, 2)
        if attempt.capped and exact.solved:  # it was ProxQP, not the QP
            self._pause(workspace)
        return exact

    def _attempt(
        self,
        qp: QP,
        check: SolveCheck,
        key: Key,
        work: Work,
        cold: float = inf,
        warm: int = WARM_ITERATIONS,
    ) -> _Attempt:
        """Ask ProxQP, warm if it can be; a workspace is kept while its answers are accepted.

        ``cold`` and ``warm`` are the caps on its iterations.
        """
        last = self._workspaces.pop(key, None)
        usual = int(min(cold if last is None else warm, self.max_iterations))
        steps, cap = COLD if last is None else WARM, usual
        if last is None or work.short:  # else there is time for all of a warm one
            # From nothing, steps that are refined in vain, for want of a solution, take thrice as
            # long.
            part = 0.7 if last is None else 1.0
            cap = _outer(steps, qp, part * (work.left - otherwise(qp)), usual)
        if cap == 0:
            return _Attempt(None, RawSolution.none(qp, Status.FAILED, NOT_ASKED), cold=True)
        native = last or Workspace.create(qp, self.eps, cap)
        if last is not None and cap < usual:
            native.cap(cap)
        raw = native.solve_cold() if last is None else native.solve_warm(qp)
        work.spent += steps.units(qp, raw.iterations)
        accepted = check.accept(qp, raw)
        if accepted is None:
            check_qp(qp)
        elif self.warm and key[0] is not None:
            self._workspaces[key] = native
            if last is None or cap < usual:
                native.cap(min(warm, self.max_iterations))
        return _Attempt(accepted, raw, cold=last is None)

    def _solve_once(self, qp: QP, check: SolveCheck, work: Work) -> Solution:
        """Solve what will not come again, in the core first: it is faster, and cycles on others."""
        found = self._one_off.solve_natively(qp, work)
        return found or self._solve_actively(qp, check, self._one_off, work)

    def _ask_actively(
        self, qp: QP, by: SolveCheck, attempts: int, work: Work
    ) -> tuple[RawSolution, Solution | None]:
        """Return what the active-set method says, and what is accepted of it."""
        exact = self.active_set.answer(qp, work)
        settled = by.accept(qp, exact, attempts)
        if settled is None:
            exact = self.active_set.finer(qp, work)
            settled = by.accept(qp, exact, attempts)
        return exact, settled

    def _solve_actively(
        self, qp: QP, check: SolveCheck, solver: Daqp, work: Work, attempts: int = 1
    ) -> Solution:
        """Solve by the active-set method."""
        exact, check = solver.answer(qp, work), check._replace(solver=solver.name)
        nearly = check._replace(eps=NEARLY * self.eps)
        return nearly.accept(qp, exact, attempts) or check.judge(qp, exact, attempts)

    def _retry(
        self,
        qp: QP,
        check: SolveCheck,
        attempt: _Attempt,
        exact: RawSolution | None,
        work: Work,
    ) -> Solution:
        """Solve by other means what was not solved, or return a status that says why not."""
        settled, by, raw = None, check._replace(solver=Daqp.name), attempt.raw
        if exact is None:
            exact, settled = self._ask_actively(qp, by, 2, work)
        finished = bool(np.isfinite(exact.x).all())  # one of the two is: each takes half a ms
        settled = settled or check.refute(qp, raw, 2)
        if settled is None and finished:
            settled = self._finish(qp, by, exact, 2, work)
        cap = 0 if attempt.cold else _outer(COLD, qp, work.left, self.max_iterations)
        if settled is None and cap > 0:
            raw = Workspace.create(qp, self.eps, cap).solve_cold()
            work.spent += COLD.units(qp, raw.iterations)
            settled = check.accept(qp, raw, 3)
        if settled is None:
            nearly = check._replace(eps=NEARLY * self.eps)
            settled = (
                nearly.accept(qp, raw, 4) if finished else self._finish(qp, check, raw, 4, work)
            )
        return settled or check._replace(explain=False).judge(qp, raw, 4)  # refuted it was not

    def _finish(
        self, qp: QP, check: SolveCheck, raw: RawSolution, attempts: int, work: Work
    ) -> Solution | None:
        """Return what settles the active set of an answer, or the answer if it is nearly right."""
        if not np.isfinite(raw.x).all():
            return None
        settled = None
        if work.has_room(POLISH.units(qp)):
            work.spent += POLISH.units(qp)
            settled = check.accept(qp, polish(qp, raw), attempts)
        return settled or check._replace(eps=NEARLY * self.eps).accept(qp, raw, attempts)


def _outer(steps: Steps, qp: QP, left: float, most: int) -> int:
    """Return how many outer iterations are afforded, ``most`` at most."""
    return steps.afforded(qp, left, INNER * most) // INNER
