"""A QP solver by name."""

from __future__ import annotations

import functools
import importlib
import inspect
import logging
from collections.abc import Callable, Hashable
from typing import Any, Protocol

from wbc.errors import InvalidInputError, SolverError, UnknownNameError
from wbc.kinds import check_word
from wbc.qp.active_set import ActiveSet
from wbc.qp.problem import QP
from wbc.qp.proxqp import ProxQP
from wbc.qp.pseudo_inverse import PseudoInverse
from wbc.qp.solution import Solution

# What to install for the solvers that are known but optional.
_EXTRAS = dict.fromkeys(("clarabel", "daqp", "osqp", "piqp"), "wbc[bench]")
_EXTRAS |= {
    name: f"qpsolvers[{name}]" for name in ("cvxopt", "ecos", "highs", "qpalm", "quadprog", "scs")
}

_NATIVE: dict[str, Callable[..., Backend]] = {
    "proxqp": ProxQP,
    "active_set": ActiveSet,
    "proxqp_cold": functools.partial(ProxQP, warm=False),
}
# Baselines that do not promise an optimum: known by name, but no choice among solvers.
_BASELINES: dict[str, Callable[..., Backend]] = {"pseudo_inverse": PseudoInverse}
LOOSEST = 1e-2  # the largest eps with which a check means anything
# At the torque level, of 143 feasible ticks from states near and far from standing clarabel, daqp
# and piqp solved all, as the native ones do.
_UNRELIABLE = {
    "osqp": "solves few ticks at the torque level but calm ones (3 of 83, and 60 of 60)",
    "pseudo_inverse": "keeps no inequality rows, those of the torque level among them",
}
_MEASURED = frozenset({"clarabel", "daqp", "piqp"})


class Backend(Protocol):
    """Solves QPs; ``Solution.status`` rests on recomputed residuals.

    ``workspace`` names the contact set, so that a backend may keep a warm start for each.
    ``quick`` asks for a bounded attempt: no search for the rows in conflict if it fails.
    """

    name: str

    def solve(self, qp: QP, workspace: Hashable = ..., quick: bool = ...) -> Solution:
        """Return the checked solution of ``qp``; InvalidInputError for a QP that is none."""
        ...


class SolverNotInstalledError(UnknownNameError, SolverError):
    """A QP solver that we know by name is not installed; the message says what to install."""

    def __init__(self, name: str, installed: tuple[str, ...]) -> None:
        super().__init__("QP solver", name, installed)
        self.args = (
            f"QP solver {name!r} is not installed: pip install '{_EXTRAS[name]}' "
            f"(installed: {', '.join(installed)})",
        )


def make_backend(name: str, **settings: Any) -> Backend:
    """Return the backend of that name.

    ``"proxqp"`` is the default, ``"proxqp_cold"`` the same without warm start, ``"active_set"`` the
    core's own method, ``"pseudo_inverse"`` a damped pseudo-inverse, the baseline; any other name is
    looked up in qpsolvers. ``"daqp"`` is of the kind of ``"active_set"``, which answers in its
    place where that package is not installed: a log says so.

    Parameters
    ----------
    settings:
        ``eps`` (accuracy promised) for every backend, ``max_iterations`` for proxqp and active_set,
        ``always`` for proxqp; through qpsolvers also the solver's own settings.

    Raises
    ------
    UnknownNameError
        No such solver; :class:`SolverNotInstalledError` when it only needs installing.
    InvalidInputError
        A setting does not exist or is out of range.
    SolverError
        The same, of a solver's own settings.
    """
    eps = settings.get("eps")
    if isinstance(eps, int | float) and eps > LOOSEST:
        raise InvalidInputError(
            f"eps of QP solver {name!r}: {eps:g} is above {LOOSEST:g}; nothing would be checked"
        )
    check_word("QP solver", name)
    maker = _maker(name)
    try:
        inspect.signature(maker).bind(**settings)
    except TypeError as error:
        raise InvalidInputError(f"settings of QP solver {name!r}: {error}") from error
    return maker(**settings)


def backend_of(solver: str | Backend) -> Backend:
    """Return a backend, given by its name or as it is.

    Raises UnknownNameError: no such solver; InvalidInputError: neither a name nor a backend.
    """
    if isinstance(solver, str):
        return make_backend(solver)
    if isinstance(solver, type) or not callable(getattr(solver, "solve", None)):
        raise InvalidInputError(
            f"solver: expected a name such as 'proxqp', or a backend, got {solver!r}"
        )
    return solver


def torque_level_doubt(backend: Backend) -> str | None:
    """Return why a backend may leave torque ticks unsolved; None: it was measured, or is yours."""
    name = backend.name
    if name in _UNRELIABLE:
        return f"QP solver {name!r} {_UNRELIABLE[name]}"
    if name not in {*_NATIVE, *_MEASURED} and name in {*_EXTRAS, *qpsolvers_names()}:
        return f"QP solver {name!r} was never measured at the torque level"
    return None


def installed_solvers() -> tuple[str, ...]:
    """Return the names that :func:`make_backend` accepts on this machine, sorted."""
    return tuple(sorted({*_NATIVE, *qpsolvers_names()}))


def qpsolvers_names() -> tuple[str, ...]:
    """Return the names of the solvers that qpsolvers finds on this machine, sorted."""
    return tuple(sorted(importlib.import_module("qpsolvers").available_solvers))


def _maker(name: str) -> Callable[..., Backend]:
    """Return the class of a backend; the optional ones are imported when asked for."""
    if name in _NATIVE or name in _BASELINES:
        return (_NATIVE | _BASELINES)[name]
    installed = installed_solvers()
    if name not in installed:
        if name == "daqp":
            logging.getLogger(__name__).warning(
                "QP solver 'daqp' is not installed; 'active_set', of the same kind, answers"
            )
            return ActiveSet
        if name in _EXTRAS:
            raise SolverNotInstalledError(name, installed)
        raise UnknownNameError("QP solver", name, installed)
    from wbc.qp.qpsolvers_backend import QpsolversBackend

    return functools.partial(QpsolversBackend, name)
