"""The nonlinear program: exact derivatives by CasADi, solved by IPOPT from one start.

Measured on a humanoid of 32 joints: the cost is 5,000 operations, its gradient 11,000, its Hessian
150,000, which CasADi's own machine evaluates in 0.05, 0.07 and 0.5 ms. Exact second derivatives
need about 25 iterations where L-BFGS needs 300 to 800. As C the Hessian takes 0.17 ms, but 4 s (9 s
if optimised) to compile, for this problem alone: longer than a search from a hundred starts lasts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from wbc.constraints.rows import SeparatedPairs, SymbolicRows
from wbc.shaping.planes import Bodies
from wbc.shaping.problem import ShapingProblem, effective_gain
from wbc.shaping.unknowns import ConfigurationMap, Unknowns
from wbc.validate import Array

IPOPT: Mapping[str, Any] = {
    "tol": 1e-8,
    "constr_viol_tol": 1e-9,
    "acceptable_tol": 1e-6,
    "acceptable_constr_viol_tol": 1e-8,
    "max_iter": 300,
    "bound_relax_factor": 0.0,  # limits are limits
    "mu_strategy": "adaptive",
    "print_level": 0,
    "sb": "yes",
}
GOOD_STATUSES = ("Solve_Succeeded", "Solved_To_Acceptable_Level")


class Start(NamedTuple):
    """Where a search begins: unknowns that are free, and parameters."""

    x: Array
    p: Array


class LocalOptimum(NamedTuple):
    """The result of a local search."""

    x: Array  # unknowns that are free
    status: str  # IPOPT's return status
    optimal: bool  # whether IPOPT reports optimality
    iterations: int


@dataclass(frozen=True, eq=False)
class Separation:
    """The bodies that a program is to keep apart."""

    bodies: Bodies
    placements: ca.Function  # (x, p) -> T (12 m, 1), of the bodies' joints as seen from the base
    map: ConfigurationMap  # from x and p to configurations


@dataclass(frozen=True, eq=False)
class Nlp:
    """Minimise f(x, p) subject to bounds on x and g(x, p); can be sent to another process.

    ``p`` ends with the factor on f and the value of every unknown of
    :class:`~wbc.shaping.unknowns.Unknowns`, from which those that do not matter are
    taken.
    """

    functions: ca.Function  # (x, p) -> (f, g)
    lower: Array  # bounds on x
    upper: Array
    g_lower: Array  # bounds on g
    g_upper: Array
    closures: int  # how many rows of g, the first ones, are contacts: equalities with 0
    separation: Separation | None  # bodies to keep apart, besides; None without
    options: Mapping[str, Any]  # of IPOPT


class Ipopt:
    """IPOPT, made ready for one program without bodies to keep apart."""

    def __init__(self, nlp: Nlp) -> None:
        x = ca.SX.sym("x", nlp.lower.size)
        p = ca.SX.sym("p", nlp.functions.size1_in(1))
        f, g = nlp.functions(x, p)
        options = ipopt_options(nlp.options)
        self._solver = ca.nlpsol("shaping", "ipopt", {"x": x, "p": p, "f": f, "g": g}, options)
        self._bounds = {"lbx": nlp.lower, "ubx": nlp.upper, "lbg": nlp.g_lower, "ubg": nlp.g_upper}

    def search(self, start: Start) -> LocalOptimum:
        """Return IPOPT's result from a start."""
        found = self._solver(x0=start.x, p=start.p, **self._bounds)
        return local_optimum(self._solver, found, start.x.size)


def local_optimum(solver: ca.Function, found: Mapping[str, ca.DM], size: int) -> LocalOptimum:
    """Return IPOPT's result, with the first ``size`` unknowns."""
    stats = solver.stats()
    status = str(stats["return_status"])
    x = np.array(found["x"], dtype=float).ravel()[:size]
    return LocalOptimum(x, status, status in GOOD_STATUSES, int(stats["iter_count"]))


def ipopt_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return CasADi's options for IPOPT with these options, silent and without exceptions."""
    found: dict[str, Any] = {f"ipopt.{key}": value for key, value in options.items()}
    return found | {"print_time": False, "error_on_fail": False, "show_eval_warnings": False}


@dataclass(frozen=True, eq=False)
class BuiltNlp:
    """A program with the maps from and to configurations."""

    nlp: Nlp
    unknowns: Unknowns  # all unknowns, also those without effect
    kept: tuple[int, ...]  # indices of the NLP's own unknowns, which have an effect

    @property
    def turns_base(self) -> bool:
        """True if the base's rotation matters, and a search may change it."""
        first = self.unknowns.problem.robot.nv - 6 + 3
        return first in self.kept

    def start(self, q: Array, scale: float = 1.0) -> Start:
        """Return the start at a configuration; the cost is multiplied by ``scale``."""
        x, p = self.unknowns.values(q)
        return Start(x[list(self.kept)], np.concatenate((p, [scale], x)))

    def scaled(self, start: Start, scale: float) -> Start:
        """Return a start with another factor on the cost."""
        p = start.p.copy()
        p[-self.unknowns.x.numel() - 1] = scale
        return start._replace(p=p)

    def configuration(self, start: Start, x: Array) -> Array:
        """Return the configuration at unknowns ``x`` of a search from ``start``."""
        return self.unknowns.map(self.kept).configuration(x, start.p)


def build_nlp(problem: ShapingProblem, seconds: float | None = None) -> BuiltNlp:
    """Return the program of a problem, with targets, weights and obstacles as they are now.

    ``seconds`` limits the time of each search.

    Rows are contacts, except the anchor, which is met by construction, and constraints on the
    posture. Rows that keep bodies apart are added only when needed: see
    :mod:`~wbc.shaping.separation`.

    Raises InvalidInputError: a task or a constraint that says nothing about postures, or an
    obstacle that moves.
    """
    unknowns = Unknowns.of(problem)
    posture = unknowns.posture
    cost = ca.SX(0.0)
    for task in problem.tasks:
        weighted = ca.DM(task.weight) * task.symbolic_error(posture)
        cost += 0.5 * effective_gain(task, problem.dt) * ca.sumsqr(weighted)
    others = [contact for contact in problem.contacts if contact is not problem.anchor]
    closure = ca.SX(ca.vertcat(*(contact.symbolic_error(posture) for contact in others)))
    still = np.zeros(closure.numel())
    parts = [one.symbolic_rows(posture) for one in problem.constraints]
    rows = [part for part in parts if isinstance(part, SymbolicRows)]
    bodies = Bodies.of(problem.robot, [part for part in parts if isinstance(part, SeparatedPairs)])
    value = ca.vertcat(closure, *(part.value for part in rows))
    placed = ca.SX(0, 1) if bodies is None else bodies.placements(posture)
    matters = ca.which_depends(ca.vertcat(cost, value, placed), unknowns.x, 1, False)
    kept = tuple(k for k, used in enumerate(matters) if used)
    x, scale = ca.SX.sym("x", len(kept)), ca.SX.sym("scale")
    constants = ca.SX.sym("constants", unknowns.x.numel())
    full = ca.SX(constants)
    full[list(kept)] = x
    f, g, T = ca.substitute([scale * cost, value, placed], [unknowns.x], [full])
    p = ca.vertcat(unknowns.p, scale, constants)
    separation = None
    if bodies is not None:
        placements = ca.Function("placements", [x, p], [T], ["x", "p"], ["T"])
        separation = Separation(bodies, placements, unknowns.map(kept))
    nlp = Nlp(
        ca.Function("shaping", [x, p], [f, g], ["x", "p"], ["f", "g"]),
        unknowns.lower[list(kept)],
        unknowns.upper[list(kept)],
        np.concatenate((still, *(part.lower for part in rows))),
        np.concatenate((still, *(part.upper for part in rows))),
        closure.numel(),
        separation,
        IPOPT if seconds is None else {**IPOPT, "max_wall_time": seconds},
    )
    return BuiltNlp(nlp, unknowns, kept)
