"""What is measured: native ProxQP and DAQP in several ways, and all that qpsolvers knows here.

A candidate is timed from a QP in our form to a point with multipliers in our form, conversion
included; the check of its answer is not part of its time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np

from wbc.errors import UnknownNameError
from wbc.qp import QP, ProxQP
from wbc.qp.backend import qpsolvers_names
from wbc.qp.daqp import Daqp, KeptDaqp
from wbc.qp.elimination import eliminate
from wbc.qp.kkt import kkt_residuals
from wbc.qp.native import DEFAULTS, Workspace
from wbc.qp.qpsolvers_backend import QpsolversBackend
from wbc.qp.solution import RawSolution, Solution, Status

CHANGES = 1000  # of DAQP's active set, at most
ITERATIONS = 20  # outer ones of ProxQP with the settings of this package
PREFIX = "qpsolvers:"


class Candidate(Protocol):
    """Solves the QPs of a sequence in order; made anew for each pass."""

    def answer(self, qp: QP) -> RawSolution:
        """Return the solver's answer, unchecked."""


class WarmProxQp:
    """ProxQP's workspace, kept while sizes stay the same and it says that it has solved.

    Parameters
    ----------
    warm:
        False: a new workspace for each QP.
    refresh:
        Whether the preconditioner is computed anew for each QP.
    settings:
        Of ProxQP, over those that the package sets.
    """

    def __init__(
        self, eps: float, warm: bool = True, refresh: bool = False, **settings: Any
    ) -> None:
        self._eps, self._warm, self._refresh, self._settings = eps, warm, refresh, settings
        self._sizes: tuple[int, ...] = ()
        self._workspace: Workspace | None = None

    def answer(self, qp: QP) -> RawSolution:
        """Return the solver's answer, unchecked."""
        sizes = (qp.g.size, qp.b.size, qp.u.size)
        if self._workspace is None or sizes != self._sizes:
            workspace = Workspace.create(qp, self._eps, ITERATIONS, **self._settings)
            raw = workspace.solve_cold()
        else:
            workspace = self._workspace
            raw = workspace.solve_warm(qp, self._refresh)
        keep = self._warm and raw.claim is Status.SOLVED
        self._workspace, self._sizes = workspace if keep else None, sizes
        return raw


class CheckedProxQp:
    """What a controller has by ``solver="proxqp"``: answers checked, failures retried by DAQP."""

    def __init__(self, eps: float) -> None:
        self._backend = ProxQP(eps)

    def answer(self, qp: QP) -> RawSolution:
        """Return the backend's solution as if it were unchecked."""
        found = self._backend.solve(qp)
        return RawSolution(
            found.x, found.y, found.z, found.z_box, found.status, found.iterations, found.message
        )


class ReducedDaqp:
    """DAQP on what is left when the equality rows are eliminated."""

    def __init__(self, eps: float) -> None:
        self._daqp = Daqp(eps, CHANGES)

    def answer(self, qp: QP) -> RawSolution:
        """Return the solver's answer, unchecked."""
        elimination = eliminate(qp)
        reduced = elimination.reduced
        raw = self._daqp.answer(reduced)
        solution = Solution(
            x=raw.x, y=np.zeros(0), z=raw.z, z_box=raw.z_box, status=raw.claim,
            residuals=kkt_residuals(reduced, raw.x, np.zeros(0), raw.z, raw.z_box),
            iterations=raw.iterations, solve_time=0.0, solver="daqp",
        )  # fmt: skip
        lifted = elimination.lift(solution)
        return raw._replace(x=lifted.x, y=lifted.y, z=lifted.z, z_box=lifted.z_box)


CANDIDATES: Mapping[str, Callable[[float], Candidate]] = {
    "proxqp_checked": CheckedProxQp,
    "proxqp": WarmProxQp,
    "proxqp_cold": lambda eps: WarmProxQp(eps, warm=False),
    "proxqp_refreshed": lambda eps: WarmProxQp(eps, refresh=True),
    "proxqp_defaults": lambda eps: WarmProxQp(eps, **DEFAULTS, eps_abs=eps),
    "daqp": lambda eps: Daqp(eps, CHANGES),
    "daqp_kept": lambda eps: KeptDaqp(eps, CHANGES),
    "daqp_reduced": ReducedDaqp,
}
ABOUT = {
    "proxqp_checked": "what controllers have: checked, DAQP where it fails; its checks are timed",
    "proxqp": "kept warm, settings of this package",
    "proxqp_cold": "a new workspace for each QP",
    "proxqp_refreshed": "kept warm, preconditioner computed anew",
    "proxqp_defaults": "kept warm, ProxQP's own settings",
    "daqp": "called directly, cold",
    "daqp_kept": "one model, its data and active set kept",
    "daqp_reduced": "equality rows eliminated first",
}


def candidate_names() -> tuple[str, ...]:
    """Return all candidates on this machine: ours, then those through qpsolvers."""
    return (*CANDIDATES, *(f"{PREFIX}{name}" for name in qpsolvers_names()))


def make_candidate(name: str, eps: float) -> Candidate:
    """Return a candidate by name, asked for an accuracy.

    Raises
    ------
    UnknownNameError
        No such candidate here.
    """
    known = candidate_names()
    if name not in known:
        raise UnknownNameError("solver of wbc bench", name, known)
    if name.startswith(PREFIX):
        return QpsolversBackend(name.removeprefix(PREFIX), eps)
    return CANDIDATES[name](eps)
