"""The default backend: ProxQP kept warm between ticks, one workspace per contact set."""

from __future__ import annotations

from collections.abc import Hashable
from time import perf_counter
from typing import NamedTuple, Protocol

from wbc.qp.active_set import NAME, NEARLY, ActiveSet, checked_settings
from wbc.qp.kkt import SolveCheck
from wbc.qp.problem import QP, check_qp, is_sound
from wbc.qp.proxqp_workspace import Workspace
from wbc.qp.solution import RawSolution, Solution, Status

# Cap on the outer iterations of warm solves: most take 1 to 3, and 20 took up to 49 ms. Cold ones
# keep theirs: with 12 every hundredth ordinary QP would be left to the active-set method.
WARM_ITERATIONS = 8
# Of cold ones of QPs whose solution is known already: all 20 took up to 18 ms.
COLD_ITERATIONS = 10
# Of warm ones at the torque level, where what has no solution is relaxed: of 470 accepted in ticks
# from wild states none needed more, and those that were not accepted took 8 ms to come to 8.
BOUNDED_WARM_ITERATIONS = 5
# Iterations of the active-set method beyond which ProxQP is not asked from nothing as well: that
# took 7 ms more in ticks from wild states; those of pushes that are survived took up to 116.
HARD, BOUNDED_HARD = 120, 32
# For how many QPs of a name that stalled the active-set method is asked first: 0.2 s at 500 Hz.
COOLDOWN = 100
# Where the equalities are eliminated: no more accuracy than is promised, and for rho, one step is
# enough where no bound is active, 5 us less than with Workspace's own; of 3000 QPs with active ones
# 47 were not solved, 43 with that.
REDUCED = {"margin": 1.0, "default_rho": 1e-8}
# mu at the velocity level: of ticks at joints' bounds ProxQP answers 1499 of 1499 in 2.6 iterations
# (80 % in 4.4 with its own mu and a tenth of eps, then the active-set method). At the torque level
# every fourth attempt of few iterations failed with it, and 1 % of them with its own.
QUICK = {"default_mu_in": 1e-3}

Key = tuple[Hashable, int, int, int]  # of a warm start: name and sizes


class Reduced(Protocol):
    """A tick's QP without its equalities, of which the core has all else."""

    @property
    def qp(self) -> QP:
        """The QP, views on the core's memory."""
        ...

    @property
    def iterations(self) -> int:
        """Of the last answer."""
        ...

    def accept(self, x: bytes, z: bytes, scale: float, iterations: int) -> bool:
        """Whether x (n,), and z (mi + n,) of rows, then of bounds, times ``scale``, will do."""
        ...

    def solve(self) -> bool:
        """Whether the core's active-set method finds an answer."""
        ...


class Answered(NamedTuple):
    """Who answered, and how many were asked."""

    solver: str
    attempts: int


class ProxQP:
    """ProxQP's dense solver, its solutions checked, its failures retried.

    Policy: (1) solve in few iterations, warm from the last tick or cold; (2) if our KKT residuals
    reject that, solve by the core's active-set method, which also proves that there is no solution
    (weights over many decades stall ProxQP); (3) accept a solution within 100 eps: a robot that
    stands still for want of 1e-7 rad/s is worse off, and the residuals tell; (4) return a status
    that says what was found. The workspace of a failed tick is dropped, so a failure cannot affect
    the next tick. Where ProxQP ran into its cap, the next 100 QPs of that name go to the active-set
    method first: what stalls once, stalls in every tick, for a millisecond each. QPs that will not
    come again (``workspace=None``) always go there first. Between calls nothing is kept but that
    and the warm start. ``Solution.solver`` says who answered.

    Parameters
    ----------
    eps:
        Accuracy: a solution is accepted when every KKT residual is below eps (1 + the largest term
        it is made of).
    max_iterations:
        Cap on ProxQP's outer iterations, per cold attempt. Ticks take 2-10; of 2870 cold solves
        none needed more than 30. A higher cap only prolongs infeasible ticks.
    warm:
        False: every solve is cold, as a stateless solver would be.
    always:
        Whether ticks ask ProxQP even where the optimum of the cost alone keeps all bounds and rows,
        and is the answer without any solver: for comparisons of solvers.

    Raises
    ------
    InvalidInputError
        eps or max_iterations out of range.
    """

    def __init__(
        self, eps: float = 1e-8, max_iterations: int = 20, warm: bool = True, always: bool = False
    ) -> None:
        self.name = "proxqp" if warm else "proxqp_cold"
        self.eps, self.max_iterations = checked_settings("ProxQP", eps, max_iterations)
        self.warm, self.always = warm, bool(always)
        self.active_set = ActiveSet(self.eps)
        self._workspaces: dict[Hashable, Workspace] = {}
        self._cooldown: dict[Hashable, int] = {}

    def __getstate__(self) -> dict[str, object]:
        """Leave warm starts out: a copied workspace of ProxQP 0.8 has lost its box."""
        return {**self.__dict__, "_workspaces": {}}

    def solve(self, qp: QP, workspace: Hashable = "default", quick: bool = False) -> Solution:
        """Return the checked solution of ``qp``; 70-80 us at n = 35 on a smooth tick.

        Parameters
        ----------
        workspace:
            Names the contact set. QPs of the same name and sizes share a warm start, so two
            contact sets of equal size need two names. None: a QP that will not come again; the
            active-set method is asked first, which starts from nothing in a third of the time.
        quick:
            Give up after step (2): for who knows what to do instead, in bounded time.

        Raises
        ------
        InvalidInputError
            See :func:`wbc.qp.problem.check_qp`.
        """
        check = SolveCheck(self.name, self.eps, perf_counter(), explain=False)
        key = workspace, qp.g.size, qp.b.size, qp.u.size
        cooling = self._cools(workspace)
        if not (key in self._workspaces and not cooling and is_sound(qp)):
            check_qp(qp)  # else the bounds are judged with the answer
        exact = None
        if cooling or workspace is None:
            exact = self.active_set.solve(qp, quick=quick)
            if quick or exact.solved or exact.status is Status.INFEASIBLE:
                return exact
        raw, accepted = self._attempt(qp, check, key, quick)
        if accepted is not None:
            return accepted
        if raw.claim is Status.ITERATION_LIMIT:
            self._cool(workspace)
        if exact is None:
            exact = self.active_set.solve(qp, quick=quick)._replace(attempts=2)
        if quick or exact.solved or exact.status is Status.INFEASIBLE:
            return exact._replace(solve_time=perf_counter() - check.started)
        nearly = check._replace(eps=NEARLY * self.eps)
        return nearly.accept(qp, raw, 2) or check.judge(qp, raw, 2)

    def solve_reduced(
        self, reduced: Reduced, workspace: Hashable, bounded: bool
    ) -> Answered | None:
        """Solve a tick's QP without its equalities; None: it has no answer.

        In few iterations, warm from the last tick; what is rejected, and all while ProxQP cools
        down, by the active-set method. Where there is no warm start that is asked first, too: a QP
        without solution takes ProxQP up to 20 ms from nothing, and it 0.1.

        Parameters
        ----------
        bounded:
            Whether what has no solution is relaxed: attempts take fewer iterations then.
        """
        warm, cold, hard = WARM_ITERATIONS, self.max_iterations, HARD
        if bounded:
            warm, cold, hard = BOUNDED_WARM_ITERATIONS, COLD_ITERATIONS, BOUNDED_HARD
        qp = reduced.qp
        key = workspace, qp.g.size, qp.b.size, qp.u.size
        cooling = self._cools(workspace)
        last = None if cooling else self._workspaces.pop(key, None)
        if last is not None and bounded and last.is_far(qp):
            last = None
        if last is None:
            if not reduced.solve():
                return None
            if cooling or reduced.iterations > hard:
                return Answered(NAME, 1)
            cap = min(cold, self.max_iterations)
            settings = REDUCED if bounded else REDUCED | QUICK
            native = Workspace.create(qp, self.eps, cap, **settings)
            native.solve_cold()
        else:
            native = last
            native.run(qp)
        results, attempts = native.native.results, 1 if last else 2
        x, z, info = results.x.tobytes(), results.z.tobytes(), results.info
        if reduced.accept(x, z, native.scale, info.iter):
            if self.warm:
                self._workspaces[key] = native
                native.cap(min(warm, self.max_iterations))
            return Answered(self.name, attempts)
        if native.is_capped:
            self._cool(workspace)
        return Answered(NAME, attempts + 1) if reduced.solve() else None

    def _cools(self, workspace: Hashable) -> bool:
        """Whether the active-set method is asked first; counts."""
        left = self._cooldown.get(workspace, 0)
        if left:
            self._cooldown[workspace] = left - 1
        return left > 0

    def _cool(self, workspace: Hashable) -> None:
        """Ask the active-set method first for a while."""
        if self.warm and workspace is not None:
            self._cooldown[workspace] = COOLDOWN

    def _attempt(
        self, qp: QP, check: SolveCheck, key: Key, quick: bool
    ) -> tuple[RawSolution, Solution | None]:
        """Ask ProxQP, warm if it can be; return what it answered, and what is accepted of it.

        A workspace is kept while its answers are accepted.
        """
        last = self._workspaces.pop(key, None)
        if last is None:
            cap = min(COLD_ITERATIONS, self.max_iterations) if quick else self.max_iterations
            native = Workspace.create(qp, self.eps, cap)
            raw = native.solve_cold()
        else:
            native, raw = last, last.solve_warm(qp)
        accepted = check.accept(qp, raw)
        if accepted is None:
            check_qp(qp)
        elif self.warm and key[0] is not None:
            self._workspaces[key] = native
            if last is None:
                native.cap(min(WARM_ITERATIONS, self.max_iterations))
        return raw, accepted
