"""The measured solvers: ProxQP in several ways, the core's method, and those of qpsolvers.

A candidate is timed from a QP in our form to a point with multipliers in our form, conversion
included; the check of its answer is not part of its time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from wbc.errors import UnknownNameError
from wbc.qp import QP, ProxQP
from wbc.qp.active_set import ActiveSet
from wbc.qp.backend import qpsolvers_names
from wbc.qp.proxqp_workspace import DEFAULTS, Workspace
from wbc.qp.qpsolvers_backend import QpsolversBackend
from wbc.qp.solution import RawSolution, Status

CHANGES = 1000  # of the active set, at most
ITERATIONS = 20  # outer ones of ProxQP with the settings of this package
PREFIX = "qpsolvers:"


class SolverCandidate(Protocol):
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
    """A controller's ``solver="proxqp"``: checked, failures retried by the core."""

    def __init__(self, eps: float) -> None:
        self._backend = ProxQP(eps)

    def answer(self, qp: QP) -> RawSolution:
        """Return the backend's solution as if it were unchecked."""
        found = self._backend.solve(qp)
        return RawSolution(
            found.x, found.y, found.z, found.z_box, found.status, found.iterations, found.message
        )


CANDIDATES: Mapping[str, Callable[[float], SolverCandidate]] = {
    "proxqp_checked": CheckedProxQp,
    "proxqp": WarmProxQp,
    "proxqp_cold": lambda eps: WarmProxQp(eps, warm=False),
    "proxqp_refreshed": lambda eps: WarmProxQp(eps, refresh=True),
    "proxqp_defaults": lambda eps: WarmProxQp(eps, **DEFAULTS, eps_abs=eps),
    "active_set": lambda eps: ActiveSet(eps, CHANGES),
}
ABOUT = {
    "proxqp_checked": "what controllers have: checked, the core if it fails; checks are timed",
    "proxqp": "kept warm, settings of this package",
    "proxqp_cold": "a new workspace for each QP",
    "proxqp_refreshed": "kept warm, preconditioner computed anew",
    "proxqp_defaults": "kept warm, ProxQP's own settings",
    "active_set": "the core's method, equality rows eliminated first, cold",
}


def candidate_names() -> tuple[str, ...]:
    """Return all candidates on this machine: ours, then those through qpsolvers."""
    return (*CANDIDATES, *(f"{PREFIX}{name}" for name in qpsolvers_names()))


def make_candidate(name: str, eps: float) -> SolverCandidate:
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
