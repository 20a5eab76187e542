"""The nonlinear program: exact derivatives by CasADi, solved by IPOPT from one start.

Measured on a humanoid of 32 joints: the cost is 5,000 operations, its gradient 11,000, its Hessian
150,000, which CasADi's own machine evaluates in 0.05, 0.07 and 0.5 ms. Exact second derivatives
need about 25 iterations where L-BFGS needs 300 to 800. As C the Hessian takes 0.17 ms, but 4 s (9 s
if optimised) to compile, for this problem alone: longer than a search from a hundred starts lasts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from wbc.controllers.shaping.problem import ShapingProblem
from wbc.controllers.shaping.rows import constraint_rows
from wbc.controllers.shaping.task_errors import symbolic_error
from wbc.controllers.shaping.unknowns import Unknowns
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
GOOD = ("Solve_Succeeded", "Solved_To_Acceptable_Level")


class Start(NamedTuple):
    """Where a search begins: unknowns that are free, and parameters."""

    x: Array
    p: Array


class Local(NamedTuple):
    """Where a search ended.

    Attributes
    ----------
    x:
        Unknowns that are free.
    status:
        IPOPT's own word.
    optimal:
        True if IPOPT says that its conditions of optimality hold.
    iterations:
        Of IPOPT.
    """

    x: Array
    status: str
    optimal: bool
    iterations: int


@dataclass(frozen=True, eq=False)
class Nlp:
    """Minimise f(x, p) subject to bounds on x and g(x, p); can be sent to another process.

    Attributes
    ----------
    functions:
        (x, p) -> (f, g); p ends with the factor on f and the value of every unknown of
        :class:`~wbc.controllers.shaping.unknowns.Unknowns`, from which those that do not matter
        are taken.
    lower, upper:
        Bounds on x.
    g_lower, g_upper:
        Bounds on g.
    closures:
        How many rows of g, the first ones, are contacts.
    """

    functions: ca.Function
    lower: Array
    upper: Array
    g_lower: Array
    g_upper: Array
    closures: int
    options: Mapping[str, Any]

    def within(self, seconds: float) -> Nlp:
        """Return the same program with a time limit for each search [s]."""
        return replace(self, options={**self.options, "max_wall_time": seconds})

    def searcher(self) -> Searcher:
        """Return what searches from starts; building it takes some 0.2 s."""
        return Searcher(self)


class Searcher:
    """IPOPT, made ready for one program."""

    def __init__(self, nlp: Nlp) -> None:
        x = ca.SX.sym("x", nlp.lower.size)
        p = ca.SX.sym("p", nlp.functions.size1_in(1))
        f, g = nlp.functions(x, p)
        options = {f"ipopt.{key}": value for key, value in nlp.options.items()}
        options |= {"print_time": False, "error_on_fail": False, "show_eval_warnings": False}
        self._solver = ca.nlpsol("shaping", "ipopt", {"x": x, "p": p, "f": f, "g": g}, options)
        self._bounds = {"lbx": nlp.lower, "ubx": nlp.upper, "lbg": nlp.g_lower, "ubg": nlp.g_upper}

    def search(self, start: Start) -> Local:
        """Return where IPOPT ends from a start."""
        found = self._solver(x0=start.x, p=start.p, **self._bounds)
        stats = self._solver.stats()
        status = str(stats["return_status"])
        x = np.array(found["x"], dtype=float).ravel()
        return Local(x, status, status in GOOD, int(stats["iter_count"]))


@dataclass(frozen=True, eq=False)
class BuiltNlp:
    """A program with the way from and to configurations.

    Attributes
    ----------
    nlp:
        The program.
    unknowns:
        All unknowns, also those that nothing depends on.
    kept:
        Indices of those that matter: the NLP's own.
    """

    nlp: Nlp
    unknowns: Unknowns
    kept: tuple[int, ...]

    @property
    def turns_base(self) -> bool:
        """True if it matters which way the base is turned, and a search may turn it."""
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
        """Return the configuration that a search from ``start`` ended at."""
        full = start.p[-self.unknowns.x.numel() :].copy()
        full[list(self.kept)] = x
        return self.unknowns.configuration(full, start.p)


def build_nlp(problem: ShapingProblem) -> BuiltNlp:
    """Return the program of a problem, with the tasks' targets and weights of this moment.

    Raises
    ------
    InvalidInputError
        A task that says nothing about postures.
    """
    unknowns = Unknowns.of(problem)
    cost = ca.SX(0.0)
    for task in problem.tasks:
        weighted = ca.DM(task.weight) * symbolic_error(task, unknowns.scene)
        cost += 0.5 * task.gain * ca.sumsqr(weighted)
    rows = constraint_rows(problem, unknowns.scene.posture)
    matters = ca.which_depends(ca.vertcat(cost, rows.value), unknowns.x, 1, False)
    kept = tuple(k for k, used in enumerate(matters) if used)
    x, scale = ca.SX.sym("x", len(kept)), ca.SX.sym("scale")
    constants = ca.SX.sym("constants", unknowns.x.numel())
    full = ca.SX(constants)
    full[list(kept)] = x
    f, g = ca.substitute([scale * cost, rows.value], [unknowns.x], [full])
    p = ca.vertcat(unknowns.p, scale, constants)
    nlp = Nlp(
        ca.Function("shaping", [x, p], [f, g], ["x", "p"], ["f", "g"]),
        unknowns.lower[list(kept)],
        unknowns.upper[list(kept)],
        rows.lower,
        rows.upper,
        rows.closures,
        IPOPT,
    )
    return BuiltNlp(nlp, unknowns, kept)
