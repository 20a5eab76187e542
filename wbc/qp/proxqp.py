"""The default backend: ProxQP kept warm between ticks, one workspace per contact set."""

from __future__ import annotations

from collections.abc import Hashable
from time import perf_counter
from typing import NamedTuple, Protocol

from wbc.qp.active_set import LAST_RESORT, NAME, ActiveSet, checked_settings
from wbc.qp.kkt import SolveCheck
from wbc.qp.problem import QP, check_qp, is_sound
from wbc.qp.proxqp_workspace import Workspace
from wbc.qp.solution import RawSolution, Solution, Status

# Cap on the outer iterations of warm solves: most take 1 to 3, and 20 took up to 49 ms. Cold solves
# use max_iterations: with 12 the active-set method would get every hundredth ordinary QP.
WARM_ITERATIONS = 8
# Of cold solves of QPs whose solution is known already: all 20 took up to 18 ms.
COLD_ITERATIONS = 10
# Of warm solves at the torque level, where infeasible QPs are relaxed: of 470 accepted in ticks
# from random states none needed more, and rejected ones took 8 ms for 8 iterations.
BOUNDED_WARM_ITERATIONS = 5
# Iterations of the active-set method beyond which ProxQP is not solved cold as well: that took 7 ms
# more in ticks from random states; ticks of survived pushes took up to 116 iterations.
ACTIVE_SET_CAP, BOUNDED_ACTIVE_SET_CAP = 120, 32
# Number of QPs after a stall that go to the active-set method first: 0.2 s at 500 Hz.
COOLDOWN = 100
# For reduced QPs: no more accuracy than promised, and a rho with which one step is enough if no
# bound is active, 5 us less than with the default; of 3000 QPs with active ones 47 were not solved,
# 43 with the default.
REDUCED_SETTINGS = {"margin": 1.0, "default_rho": 1e-8}
# mu at the velocity level: ProxQP solves 1499 of 1499 ticks at joint limits in 2.6 iterations (80 %
# in 4.4 with the default mu and a tenth of eps, then the active-set method). At the torque level a
# quarter of the short attempts failed with it, and 1 % with the default.
VELOCITY_LEVEL = {"default_mu_in": 1e-3}

Key = tuple[Hashable, int, int, int]  # of a warm start: workspace name and sizes


class Reduced(Protocol):
    """A tick's QP in the core, with the equalities eliminated."""

    @property
    def qp(self) -> QP:
        """The QP, views on the core's memory."""
        ...

    @property
    def iterations(self) -> int:
        """Iterations of the last solution."""
        ...

    def accept(self, x: bytes, z: bytes, scale: float, iterations: int) -> bool:
        """Return whether x (n,) and ``scale`` z (mi + n,), rows then bounds, are accurate."""
        ...

    def solve(self) -> bool:
        """Solve by the core's active-set method; return whether that worked."""
        ...


class SolverCall(NamedTuple):
    """The solver that succeeded, and the number of attempts."""

    solver: str
    attempts: int


class ProxQP:
    """ProxQP's dense solver, its solutions checked, its failures retried.

    Policy: (1) solve in few iterations, warm from the last tick or cold; (2) if our KKT residuals
    reject that, solve by the core's active-set method, which also proves infeasibility (weights
    over many decades stall ProxQP); (3) accept a solution within 100 eps: standing still for want
    of 1e-7 rad/s would be worse, and the residuals are reported; (4) return the status that the
    evidence supports. The workspace of a failed tick is dropped, so a failure cannot affect the
    next tick. If ProxQP reached its cap, the next 100 QPs of that name go to the active-set method
    first: a QP that stalls once stalls in every tick, for a millisecond each. QPs that will not be
    solved again (``workspace=None``) always go there first. Between calls only that count and the
    warm start are kept. ``Solution.solver`` names the solver that succeeded.

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
        Whether ticks call ProxQP even where the optimum of the cost alone keeps all bounds and
        rows, and no solver is needed: for comparisons of solvers.

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
            Names the contact set. QPs of the same name and sizes share a warm start, so two contact
            sets of equal size need two names. None: a QP that will not be solved again; the
            active-set method is called first, which takes a third of a cold solve's time.
        quick:
            Give up after step (2): in bounded time, for callers with another fallback.

        Raises
        ------
        InvalidInputError
            See :func:`wbc.qp.problem.check_qp`.
        """
        check = SolveCheck(self.name, self.eps, perf_counter(), explain=False)
        key = workspace, qp.g.size, qp.b.size, qp.u.size
        cooling = self._in_cooldown(workspace)
        if not (key in self._workspaces and not cooling and is_sound(qp)):
            check_qp(qp)  # else the bounds are checked with the solution
        exact = None
        if cooling or workspace is None:
            exact = self.active_set.solve(qp, quick=quick)
            if quick or exact.solved or exact.status is Status.INFEASIBLE:
                return exact
        raw, accepted = self._attempt(qp, check, key, quick)
        if accepted is not None:
            return accepted
        if raw.claim is Status.ITERATION_LIMIT:
            self._start_cooldown(workspace)
        if exact is None:
            exact = self.active_set.solve(qp, quick=quick)._replace(attempts=2)
        if quick or exact.solved or exact.status is Status.INFEASIBLE:
            return exact._replace(solve_time=perf_counter() - check.started)
        nearly = check._replace(eps=LAST_RESORT * self.eps)
        return nearly.accept(qp, raw, 2) or check.judge(qp, raw, 2)

    def solve_reduced(
        self, reduced: Reduced, workspace: Hashable, bounded: bool
    ) -> SolverCall | None:
        """Solve a tick's reduced QP; None: it was not solved.

        By ProxQP in few iterations, warm from the last tick; if rejected, or during the cooldown,
        by the active-set method. Without a warm start that is called first, too: an infeasible QP
        takes ProxQP up to 20 ms cold, and the active-set method 0.1.

        Parameters
        ----------
        bounded:
            Whether infeasible QPs are relaxed by the caller: attempts take fewer iterations then.
        """
        warm, cold, active_set_cap = WARM_ITERATIONS, self.max_iterations, ACTIVE_SET_CAP
        if bounded:
            warm, cold = BOUNDED_WARM_ITERATIONS, COLD_ITERATIONS
            active_set_cap = BOUNDED_ACTIVE_SET_CAP
        qp = reduced.qp
        key = workspace, qp.g.size, qp.b.size, qp.u.size
        cooling = self._in_cooldown(workspace)
        last = None if cooling else self._workspaces.pop(key, None)
        if last is not None and bounded and last.is_far(qp):
            last = None
        if last is None:
            if not reduced.solve():
                return None
            if cooling or reduced.iterations > active_set_cap:
                return SolverCall(NAME, 1)
            cap = min(cold, self.max_iterations)
            settings = REDUCED_SETTINGS if bounded else REDUCED_SETTINGS | VELOCITY_LEVEL
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
            return SolverCall(self.name, attempts)
        if native.is_capped:
            self._start_cooldown(workspace)
        return SolverCall(NAME, attempts + 1) if reduced.solve() else None

    def _in_cooldown(self, workspace: Hashable) -> bool:
        """Return whether the active-set method is called first; counts down."""
        left = self._cooldown.get(workspace, 0)
        if left:
            self._cooldown[workspace] = left - 1
        return left > 0

    def _start_cooldown(self, workspace: Hashable) -> None:
        """Call the active-set method first for the next ``COOLDOWN`` QPs."""
        if self.warm and workspace is not None:
            self._cooldown[workspace] = COOLDOWN

    def _attempt(
        self, qp: QP, check: SolveCheck, key: Key, quick: bool
    ) -> tuple[RawSolution, Solution | None]:
        """Solve by ProxQP, warm if possible; return its solution, and the accepted one or None.

        A workspace is kept while its solutions are accepted.
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
