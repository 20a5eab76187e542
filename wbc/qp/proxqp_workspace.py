"""ProxQP's own dense solver: how a workspace is made, solved cold, and solved again warm.

Settings were measured on 28 sequences x 80 ticks of robot-like QPs (n = 35; 0, 6 or 12 equality
rows; 0-30 inequality rows; 2-6 active bounds; damping 1e-6 to 1e-2), smooth or jumping by a third
of their data every tick, on torque-level QPs (n = 59, 18 + 69 rows), and cold on 1500 small random
QPs. "Wrong" means status "solved" and KKT residuals that disagree; x was then off by up to 0.8.

- ProxQP does not test complementarity. A multiplier of the wrong sign is invisible once its penalty
  mu has shrunk to 1e-8; one at a bound that is not reached shows only in the duality gap.
- Gap test on, eps_abs 1e-9: cold 0 of 2870 wrong (33 without the gap test, 20 without bcl_update).
  Warm 0 of 2240 wrong when smooth, 15 when jumping. Without the gap test and with eps_abs 1e-8 or
  1e-6: 1.7 and 7 % when jumping; a relative eps does the same. Less than 1e-9 stalls.
- rho 1e-7: the default 1e-6 stalls for a millisecond and more where P has eigenvalues of 1e-6;
  1e-8 is 5 us faster and doubles the wrong answers.
- Median us of update and solve: smooth 50 (p99 200), jumping 165, torque 180; cold 120 to 190.
  Refreshing the preconditioner every tick costs 25 and gains nothing. PrimalLDLT stalls.
- The infeasibility tests at their default of 1e-4 are often wrong; at 1e-14 hardly ever.

Same input, same bits: ProxQP keeps its factors in memory of plain ``malloc``, aligned to 16 bytes.
Its builds for AVX2 and AVX-512 work in packets of 32 bytes and more from the first aligned entry
on, so that where the memory lies decides how sums are grouped: the last bits differ between
identical processes. The build without AVX has packets of 16 bytes, and gives the same bits wherever
its memory lies and whatever AVX the machine has; at n = 35 it takes 3 to 5 % longer, at n = 59 a
third. One process can load one build only: it is the wide one if proxsuite was imported before.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from typing import Any

from wbc.qp.kkt import largest
from wbc.qp.problem import QP
from wbc.qp.solution import RawSolution, Status
from wbc.validate import Array

# Builds of proxsuite that it would choose by the processor.
_WIDE = ("avx512", "avx2")


def _import_proxqp() -> Any:
    """Import ProxQP in the build whose results do not depend on where memory lies."""
    wide = [f"proxsuite.proxsuite_pywrap_{build}" for build in _WIDE]
    loaded: dict[str, Any] = sys.modules
    if "proxsuite" not in loaded:
        loaded |= dict.fromkeys(wide)  # None: proxsuite finds these missing
        try:
            import proxsuite  # noqa: F401
        finally:
            for name in wide:
                del loaded[name]
    from proxsuite import proxqp

    return proxqp


proxqp = _import_proxqp()
# "" or, if proxsuite was imported before by others, the wide build: the last bits then vary.
BUILD = next((build for build in _WIDE if build in proxqp.__name__), "")

_RHO = 1e-7
# ProxQP's eps as a share of the promised accuracy; see above why.
MARGIN = 0.1
# Its least eps relative to the QP's numbers: costs of 1e6 would iterate until the cap otherwise.
_ROUNDING = 2e-15
# Inner iterations per outer one: with 10 as many QPs are solved, and unsolved ones take twice as
# long; without a cap an infeasible QP takes 25,000.
_INNER = 5
# Relative squared change of g beyond which a warm start is dropped: of 123 QPs that were solved
# warm in 10,000 ticks from random states at most two were beyond, and unsolved ones took up to 9
# ms.
FAR_CHANGE = 0.25
# ProxQP's infeasibility tests are disabled, we search a certificate: even at 1e-14 they have called
# a QP infeasible whose right-hand side was 1e-14 of rounding.
_INFEASIBILITY = 0.0

# ProxQP's own defaults of settings that this package changes: a choice of wbc bench.
DEFAULTS = {
    name: getattr(proxqp.dense.QP(1, 0, 0).settings, name)
    for name in ("check_duality_gap", "default_rho", "max_iter", "max_iter_in")
}

_CLAIMS = {
    proxqp.QPSolverOutput.PROXQP_SOLVED: Status.SOLVED,
    proxqp.QPSolverOutput.PROXQP_MAX_ITER_REACHED: Status.ITERATION_LIMIT,
    proxqp.QPSolverOutput.PROXQP_PRIMAL_INFEASIBLE: Status.INFEASIBLE,
    proxqp.QPSolverOutput.PROXQP_DUAL_INFEASIBLE: Status.FAILED,  # unbounded below
}


@dataclass(frozen=True, slots=True, eq=False)
class Workspace:
    """One native solver object with its factorisation, preconditioner and last solution."""

    native: Any
    inequalities: int
    scale: float  # of the cost, as the native solver sees it
    g: Array  # (n,) of the last QP: a copy

    @classmethod
    def create(
        cls, qp: QP, eps: float, max_iterations: int, margin: float = MARGIN, **others: Any
    ) -> Workspace:
        """Return a workspace loaded with ``qp``, set for a cold solve to ``margin * eps``.

        ``others``: ProxQP's settings by name, over those set here: for benchmarks.
        """
        mi = qp.u.size
        native = proxqp.dense.QP(qp.g.size, qp.b.size, mi, True)
        settings = native.settings
        scale = _cost_scale(qp.P)
        P, g = scale * qp.P, scale * qp.g
        most = max(map(largest, (P.ravel(), g, qp.b)))
        settings.eps_abs = max(margin * eps, _ROUNDING * most)
        settings.eps_rel = 0.0
        settings.check_duality_gap = True
        settings.eps_duality_gap_abs = settings.eps_abs
        settings.eps_duality_gap_rel = 0.0
        settings.eps_primal_inf = settings.eps_dual_inf = _INFEASIBILITY
        settings.default_rho = _RHO
        settings.max_iter = max_iterations
        settings.max_iter_in = _INNER
        settings.initial_guess = proxqp.InitialGuess.NO_INITIAL_GUESS
        for name, value in others.items():
            setattr(settings, name, value)
        native.init(P, g, qp.A, qp.b, qp.C, qp.l, qp.u, qp.lower, qp.upper)
        return cls(native, mi, scale, qp.g.copy())

    @property
    def is_capped(self) -> bool:
        """Whether the last solve ran into its cap of iterations."""
        return _CLAIMS.get(self.native.results.info.status) is Status.ITERATION_LIMIT

    def is_far(self, qp: QP) -> bool:
        """Whether ``qp`` is so far from the last QP that its solution is hardly a start."""
        change = qp.g - self.g
        return bool(change.dot(change) > FAR_CHANGE * qp.g.dot(qp.g))

    def cap(self, max_iterations: int) -> None:
        """Bound the outer iterations of the next solves."""
        self.native.settings.max_iter = max_iterations

    def solve_cold(self) -> RawSolution:
        """Solve the QP given to :meth:`create`; the workspace is warm afterwards."""
        self.native.solve()
        warm = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        self.native.settings.initial_guess = warm
        return self._answer()

    def solve_warm(self, qp: QP, refresh: bool = False) -> RawSolution:
        """Solve ``qp``, of the same sizes, starting from the last solution.

        ``refresh``: compute the preconditioner anew.
        """
        self.run(qp, refresh)
        return self._answer()

    def run(self, qp: QP, refresh: bool = False) -> None:
        """Solve ``qp`` as :meth:`solve_warm` does, without reading the answer."""
        native = self.native
        P, g = (qp.P, qp.g) if self.scale == 1.0 else (self.scale * qp.P, self.scale * qp.g)
        A, b = (qp.A, qp.b) if qp.b.size else (None, None)
        # Never solve() twice without update(): ProxQP 0.8 then scales the box a second time.
        native.update(P, g, A, b, qp.C, qp.l, qp.u, qp.lower, qp.upper, refresh)
        native.solve()
        self.g[:] = qp.g

    def _answer(self) -> RawSolution:
        results, mi = self.native.results, self.inequalities
        status = results.info.status
        claim = _CLAIMS.get(status, Status.FAILED)
        z = results.z / self.scale  # copies: the next solve overwrites the native arrays
        return RawSolution(
            x=results.x.copy(),
            y=results.y / self.scale,
            z=z[:mi],
            z_box=z[mi:],
            claim=claim,
            iterations=results.info.iter,
            message="" if claim is Status.SOLVED else status.name,
        )


def _cost_scale(P: Array) -> float:
    """Return a power of two that brings the largest curvature up to 1.

    With a cost of 1e-3 the multipliers of active bounds sink into the accuracy asked for, and
    ProxQP stops with bounds half active. Costs above 1 are left alone: large multipliers are seen.
    """
    most = largest(P.diagonal())
    return 2.0 ** math.ceil(-math.log2(most)) if 1e-12 < most < 1.0 else 1.0
