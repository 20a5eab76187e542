"""Any solver of qpsolvers, for comparison: stateless, its solutions checked like ours."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
import qpsolvers
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from wbc.errors import SolverError
from wbc.qp.kkt import SolveCheck
from wbc.qp.problem import QP, check_qp
from wbc.qp.solution import RawSolution, Solution, Status
from wbc.validate import Array, finite_number

Index = NDArray[np.intp]

# At a duality gap of d an interior point may still be sqrt(d) away from a weakly active bound;
# asked for less than 1e-13, Clarabel runs past the optimum and diverges now and then.
_GAP = 1e-13

# Settings of each solver for one accuracy. A solver that is not listed keeps its defaults.
_ACCURACY: Mapping[str, Callable[[float], dict[str, Any]]] = {
    "clarabel": lambda eps: {"tol_feas": eps, "tol_gap_abs": _GAP, "tol_gap_rel": _GAP},
    "daqp": lambda eps: {"primal_tol": eps},
    "osqp": lambda eps: {"eps_abs": eps, "eps_rel": 0.0, "max_iter": 20_000},
    "piqp": lambda eps: {
        "eps_abs": eps,
        "eps_rel": 0.0,
        "eps_duality_gap_abs": _GAP,
        "eps_duality_gap_rel": 0.0,
    },
    "proxqp": lambda eps: {
        "eps_abs": eps,
        "eps_rel": 0.0,
        "check_duality_gap": True,
        "eps_duality_gap_abs": eps,
        "eps_duality_gap_rel": 0.0,
    },
}
# Caps on iterations of quick attempts. Of 112 and 104 QPs from random states Clarabel and PIQP
# solved as many to the accuracy promised as with their own caps of 200 and 250, which take up to 28
# and 4 ms. OSQP solved half of 16, and all in 20,000 steps, which take 37 ms.
_QUICK = {"clarabel": 30, "osqp": 400, "piqp": 30}
# These accept infinite bounds in their own box; for all others finite bounds become rows.
_BOX = frozenset({"daqp", "osqp", "piqp"})
# Settings are given a tenth of the accuracy promised: each scales its residuals differently.
_MARGIN = 0.1


class QpsolversBackend:
    """One solver of the qpsolvers package by name, cold every time.

    ``name``: a name in ``qpsolvers.available_solvers``; see :func:`wbc.qp.backend.make_backend`.
    ``eps``: accuracy promised, as in :class:`wbc.qp.proxqp.ProxQP`.
    ``settings``: passed to the solver as they are, over those that set the accuracy.

    Raises InvalidInputError: an eps out of range; SolverError: the solver does not take the
    settings.
    """

    def __init__(self, name: str, eps: float = 1e-8, **settings: Any) -> None:
        self.name = name
        self.eps = finite_number(f"eps of {name}", eps, least=1e-12)
        accuracy = _ACCURACY[name](_MARGIN * self.eps) if name in _ACCURACY else {}
        self._settings = accuracy | settings
        cap = {"max_iter": _QUICK[name]} if name in _QUICK else {}
        self._quick = accuracy | cap | settings
        self._dense = name in qpsolvers.dense_solvers
        if settings:
            self._try_settings(settings)

    def _matrix(self, matrix: Array) -> Array | csc_matrix:
        return (np.array if self._dense else csc_matrix)(matrix, dtype=np.float64)

    def _try_settings(self, settings: Mapping[str, Any]) -> None:
        """Solve a QP of one unknown: solvers look at their settings when they solve."""
        small = qpsolvers.Problem(self._matrix(np.eye(1)), np.ones(1), lb=np.zeros(1))
        refused: object = None
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                qpsolvers.solve_problem(small, self.name, **{**self._settings, "verbose": False})
        except Exception as error:  # each has exceptions of its own
            refused = error
        if self.name == "piqp":  # by qpsolvers what it does not know is left out in silence
            known = dir(importlib.import_module("piqp").DenseSolver().settings)
            unknown = sorted(settings.keys() - {*known, "backend"})
            refused = refused or (unknown and f"no such settings: {', '.join(unknown)}")
        if refused:
            raise SolverError(f"QP solver {self.name!r} refused its settings {settings}: {refused}")

    def solve(self, qp: QP, workspace: Hashable = "default", quick: bool = False) -> Solution:
        """Return the checked solution of ``qp``; ``workspace`` is ignored.

        ``quick``: in few iterations; if there is none, do not search for the rows in conflict.

        Raises InvalidInputError: see :func:`wbc.qp.problem.check_qp`; SolverError: the solver does
        not take the settings it was given.
        """
        check = SolveCheck(self.name, self.eps, perf_counter(), explain=not quick)
        check_qp(qp)
        return check.judge(qp, self.answer(qp, quick))

    def answer(self, qp: QP, quick: bool = False) -> RawSolution:
        """Return the solver's answer, unchecked."""
        settings = self._quick if quick else self._settings
        keep_box = self.name in _BOX
        rows = OneSided.of(qp, keep_box)
        matrix = self._matrix
        problem = qpsolvers.Problem(
            matrix(qp.P),
            _writable(qp.g),
            matrix(rows.G) if rows.h.size else None,
            _writable(rows.h) if rows.h.size else None,
            matrix(qp.A) if qp.b.size else None,
            _writable(qp.b) if qp.b.size else None,
            _writable(qp.lower) if keep_box else None,
            _writable(qp.upper) if keep_box else None,
        )
        try:
            with warnings.catch_warnings():
                # They warn about every status but "solved"; ours is in the Solution.
                warnings.simplefilter("ignore")
                found = qpsolvers.solve_problem(problem, self.name, **settings)
        except (qpsolvers.exceptions.QPError, ValueError, RuntimeError) as error:
            return RawSolution.none(qp, Status.FAILED, str(error))
        except (TypeError, AttributeError) as error:
            raise SolverError(
                f"QP solver {self.name!r} refused its settings {settings}: {error}"
            ) from error
        return _answer(qp, rows, found)


@dataclass(frozen=True, slots=True, eq=False)
class OneSided:
    """Finite ends only: upper ends of C, lower ends of C, then the same of the box.

    ``box_upper`` and ``box_lower`` are empty when the solver takes the box as it is.
    """

    G: Array  # (m, n)
    h: Array  # (m,)
    upper: Index
    lower: Index
    box_upper: Index
    box_lower: Index

    @classmethod
    def of(cls, qp: QP, keep_box: bool) -> OneSided:
        """Return the one-sided rows of ``qp``, with rows for its box unless ``keep_box``."""
        upper, lower = np.flatnonzero(np.isfinite(qp.u)), np.flatnonzero(np.isfinite(qp.l))
        G, h = [qp.C[upper], -qp.C[lower]], [qp.u[upper], -qp.l[lower]]
        box_upper = box_lower = np.zeros(0, dtype=np.intp)
        if not keep_box:
            box_upper = np.flatnonzero(np.isfinite(qp.upper))
            box_lower = np.flatnonzero(np.isfinite(qp.lower))
            unit = np.eye(qp.g.size)
            G += [unit[box_upper], -unit[box_lower]]
            h += [qp.upper[box_upper], -qp.lower[box_lower]]
        return cls(np.concatenate(G), np.concatenate(h), upper, lower, box_upper, box_lower)

    def two_sided(self, qp: QP, multipliers: Array) -> tuple[Array, Array]:
        """Return z (mi,) and z_box (n,) for multipliers (m,) >= 0 of ``G x <= h``."""
        z, z_box = np.zeros(qp.u.size), np.zeros(qp.g.size)
        parts = (self.upper, self.lower, self.box_upper, self.box_lower)
        up, low, box_up, box_low = np.split(multipliers, np.cumsum([p.size for p in parts[:3]]))
        z[self.upper] += up
        z[self.lower] -= low
        z_box[self.box_upper] += box_up
        z_box[self.box_lower] -= box_low
        return z, z_box


def _writable(vector: Array) -> Array:
    """Return a copy as Cython's solvers ask for it: writable, of doubles."""
    return np.array(vector, dtype=np.float64)


def _answer(qp: QP, rows: OneSided, found: Any) -> RawSolution:
    """Return what qpsolvers found with multipliers of our rows; their signs agree with ours."""
    if found.x is None or not np.isfinite(found.x).all():
        return RawSolution.none(qp, Status.FAILED, "no solution found")
    z, z_box = rows.two_sided(qp, _sized(found.z, rows.h.size))
    if found.z_box is not None and np.size(found.z_box):
        z_box += found.z_box
    return RawSolution(
        x=np.asarray(found.x, dtype=np.float64),
        y=_sized(found.y, qp.b.size),
        z=z,
        z_box=z_box,
        claim=Status.SOLVED if found.found else Status.FAILED,
        iterations=_iterations(found.extras),
        message="" if found.found else "no solution found",
    )


def _sized(multipliers: Any, size: int) -> Array:
    """Return (size,) multipliers; NaN when the solver reports none, or another number of them."""
    vector = np.asarray([] if multipliers is None else multipliers, dtype=np.float64)
    return vector if vector.size == size else np.full(size, np.nan)


def _iterations(extras: Mapping[str, Any]) -> int:
    """Return the iteration count where a solver reports one, else 0."""
    count = extras.get("iterations", getattr(extras.get("info"), "iter", 0))
    return int(np.ravel(count)[0])
