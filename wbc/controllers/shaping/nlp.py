"""The nonlinear program: exact derivatives by CasADi, solved by IPOPT from one start.

Measured on a humanoid of 32 joints: the cost is 5,000 operations, its gradient 11,000, its Hessian
150,000, which CasADi's own machine evaluates in 0.05, 0.07 and 0.5 ms. Exact second derivatives
need about 25 iterations where L-BFGS needs 300 to 800. As C the Hessian takes 0.17 ms, but 4 s (9 s
if optimised) to compile, for this problem alone: longer than a search from a hundred starts lasts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from wbc.constraints.rows import SeparatedPairs, SymbolicRows
from wbc.controllers.shaping.apart import ApartSearcher, Watched
from wbc.controllers.shaping.bodies import Bodies
from wbc.controllers.shaping.problem import ShapingProblem
from wbc.controllers.shaping.program import IPOPT, Local, Program, Searcher, Start
from wbc.controllers.shaping.rows import constraint_rows
from wbc.controllers.shaping.unknowns import Unknowns
from wbc.validate import Array

__all__ = ["BuiltNlp", "Local", "Nlp", "Start", "build_nlp"]


@dataclass(frozen=True, eq=False)
class Nlp(Program):
    """The program of a shaping problem.

    ``p`` ends with the factor on f and the value of every unknown of
    :class:`~wbc.controllers.shaping.unknowns.Unknowns`, from which those that do not matter are
    taken.

    Attributes
    ----------
    closures:
        How many rows of g, the first ones, are contacts.
    watched:
        Bodies to keep apart; None without.
    """

    closures: int
    watched: Watched | None

    def within(self, seconds: float) -> Nlp:
        """Return the same program with a time limit for each search [s]."""
        return replace(self, options={**self.options, "max_wall_time": seconds})

    def searcher(self) -> Searcher | ApartSearcher:
        """Return what searches from starts; building it takes some 0.2 s."""
        return Searcher(self) if self.watched is None else ApartSearcher(self, self.watched)


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
        return self.unknowns.chart(self.kept).configuration(x, start.p)


def build_nlp(problem: ShapingProblem) -> BuiltNlp:
    """Return the program of a problem, with targets, weights and obstacles as they are now.

    Raises
    ------
    InvalidInputError
        A task that says nothing about postures, or an obstacle that moves.
    """
    unknowns = Unknowns.of(problem)
    cost = ca.SX(0.0)
    for task in problem.tasks:
        weighted = ca.DM(task.weight) * task.symbolic_error(unknowns.posture)
        cost += 0.5 * task.gain * ca.sumsqr(weighted)
    parts = [one.symbolic_rows(unknowns.posture) for one in problem.constraints]
    symbolic = [part for part in parts if isinstance(part, SymbolicRows)]
    rows = constraint_rows(problem, unknowns.posture, symbolic)
    separated = [part for part in parts if isinstance(part, SeparatedPairs)]
    bodies = Bodies.of(problem.robot, separated)
    placed = ca.SX(0, 1) if bodies is None else bodies.placements(unknowns.posture)
    matters = ca.which_depends(ca.vertcat(cost, rows.value, placed), unknowns.x, 1, False)
    kept = tuple(k for k, used in enumerate(matters) if used)
    x, scale = ca.SX.sym("x", len(kept)), ca.SX.sym("scale")
    constants = ca.SX.sym("constants", unknowns.x.numel())
    full = ca.SX(constants)
    full[list(kept)] = x
    f, g, T = ca.substitute([scale * cost, rows.value, placed], [unknowns.x], [full])
    p = ca.vertcat(unknowns.p, scale, constants)
    watched = None
    if bodies is not None:
        placements = ca.Function("placements", [x, p], [T], ["x", "p"], ["T"])
        watched = Watched(bodies, placements, unknowns.chart(kept))
    nlp = Nlp(
        ca.Function("shaping", [x, p], [f, g], ["x", "p"], ["f", "g"]),
        unknowns.lower[list(kept)],
        unknowns.upper[list(kept)],
        rows.lower,
        rows.upper,
        IPOPT,
        rows.closures,
        watched,
    )
    return BuiltNlp(nlp, unknowns, kept)
