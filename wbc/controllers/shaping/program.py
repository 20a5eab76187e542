"""A program for IPOPT, and a search with it from one start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

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
class Program:
    """Minimise f(x, p) subject to bounds on x and g(x, p); can be sent to another process.

    Attributes
    ----------
    functions:
        (x, p) -> (f, g).
    lower, upper:
        Bounds on x.
    g_lower, g_upper:
        Bounds on g.
    options:
        Of IPOPT.
    """

    functions: ca.Function
    lower: Array
    upper: Array
    g_lower: Array
    g_upper: Array
    options: Mapping[str, Any]


class Searcher:
    """IPOPT, made ready for one program."""

    def __init__(self, program: Program) -> None:
        x = ca.SX.sym("x", program.lower.size)
        p = ca.SX.sym("p", program.functions.size1_in(1))
        f, g = program.functions(x, p)
        options = solver_options(program.options)
        self._solver = ca.nlpsol("shaping", "ipopt", {"x": x, "p": p, "f": f, "g": g}, options)
        self._bounds = {
            "lbx": program.lower,
            "ubx": program.upper,
            "lbg": program.g_lower,
            "ubg": program.g_upper,
        }

    def search(self, start: Start) -> Local:
        """Return where IPOPT ends from a start."""
        found = self._solver(x0=start.x, p=start.p, **self._bounds)
        return ended(self._solver, found, start.x.size)


def ended(solver: ca.Function, found: Mapping[str, ca.DM], size: int) -> Local:
    """Return where IPOPT ended, as the first ``size`` unknowns."""
    stats = solver.stats()
    status = str(stats["return_status"])
    x = np.array(found["x"], dtype=float).ravel()[:size]
    return Local(x, status, status in GOOD, int(stats["iter_count"]))


def solver_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return CasADi's options for IPOPT with these options of its own, silent and without raise."""
    found: dict[str, Any] = {f"ipopt.{key}": value for key, value in options.items()}
    return found | {"print_time": False, "error_on_fail": False, "show_eval_warnings": False}
