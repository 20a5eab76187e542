"""Strict priorities: a level may only use the freedom that the levels above it leave.

Level by level a QP is solved; what it achieves for its tasks, ``W J x*``, becomes equality rows for
the next one (lexicographic optimisation, as Kanoun, Lamiraux and Wieber 2011). Limits and contacts
hold on every level, so a lower one can always do what the higher one did: no level is infeasible.
The achieved rows repeat each other and the contacts more often than not, hence below the first
level the equalities are eliminated by a rank-revealing factorisation.

Active bounds that the achieved rows imply stay active below: see
:mod:`wbc.controllers.active_set`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from wbc.constraints.limits import Limits
from wbc.constraints.rows import Bounds, stack
from wbc.controllers.active_set import ActiveSet, achieved_rows
from wbc.controllers.asking import Solvers
from wbc.controllers.braking import relax_box, scale_gains_to_brake
from wbc.controllers.level_problem import Box, LevelProblem
from wbc.controllers.plan import Plan, assemble, outweighing
from wbc.controllers.relaxation import given_way, relaxed_qp
from wbc.controllers.singular import Singularity, reduce_singular
from wbc.controllers.slack import GivingQP
from wbc.laws import Rows
from wbc.qp.backend import Backend
from wbc.qp.elimination import Elimination, eliminate
from wbc.qp.problem import QP
from wbc.qp.solution import Solution, Status
from wbc.robot.tree import LARGEST
from wbc.validate import Array

# How equalities are treated: as rows of the QP, or eliminated before it.
FORMULATIONS = ("equality", "reduced")
# A command may exceed a bound of its box by this [rad/s or m/s]: what accepted solutions leave.
TOLERANCE = 1e-6


class Outcome(NamedTuple):
    """What the levels of one tick came to.

    Attributes
    ----------
    qp, solution:
        Of the last level that was solved, or of the one that could not be.
    first:
        The QP of the first level: its box is the limits', relaxed where braking had to be harder.
    nv:
        Size of the velocity, the first of the unknowns.
    solve_time:
        In solvers [s], over all levels.
    singular:
        Of each task with a singular threshold on the levels below the first.
    given_way:
        What a relaxed QP misses, by name; None where nothing was relaxed.
    giving:
        The relaxed QP, of which ``qp`` lacks the slacks; None: nothing was relaxed.
    """

    qp: QP
    solution: Solution
    first: QP
    nv: int
    solve_time: float
    singular: dict[str, Singularity]
    given_way: dict[str, float] | None = None
    giving: GivingQP | None = None

    @property
    def solved(self) -> bool:
        """Whether every level was solved."""
        return self.solution.status is Status.SOLVED

    @property
    def velocity(self) -> Array:
        """The velocity at the end of the tick (nv,)."""
        return self.solution.x[: self.nv]

    @property
    def box(self) -> Box:
        """The bounds (nv,), (nv,) on the velocity that the first level kept."""
        return self.first.lower[: self.nv], self.first.upper[: self.nv]

    def within_limits(self, names: Sequence[str]) -> Outcome:
        """Refuse a solution outside the limits in the robot's own units, whatever it rests on.

        Without limits what a robot's state may have is one: where it led could not be looked at.
        Residuals are judged relative to the numbers of the QP, which may be huge; joints are not.
        ``names`` are those of the unknowns.
        """
        solution, nv = self.solution, self.nv
        if solution.status is not Status.SOLVED:
            return self
        lower, upper, v = self.first.lower, self.first.upper, solution.x
        if v.size > nv or lower.size > nv:  # in no plain tick
            lower, upper, v = lower[:nv], upper[:nv], v[:nv]
        excess = np.maximum(lower - v, v - upper)
        worst = int(excess.argmax())
        if excess.item(worst) <= TOLERANCE:  # NaN is not
            if np.vdot(v, v) <= LARGEST * LARGEST or np.abs(v).max() <= LARGEST:
                return self
            worst, where = int(np.abs(v).argmax()), f"beyond {LARGEST:g}, which no state may have"
        else:
            where = f"outside its limits [{lower[worst]:.6g}, {upper[worst]:.6g}]"
        solution = solution._replace(
            status=Status.CONTRADICTED,
            message=f"{names[worst]} at {v[worst]:.6g}, {where}: not commanded",
        )
        return self._replace(solution=solution)


class LevelSolver:
    """Solves the QPs of all levels of a plan.

    Parameters
    ----------
    root:
        (nv,) square roots of the joints' weights.
    reduced:
        Whether the first level's equalities are eliminated too.
    quick:
        Whether solvers are asked for one bounded attempt, since the caller relaxes what fails.
    """

    def __init__(
        self,
        plan: Plan,
        names: Sequence[str],
        backend: Backend,
        limits: Limits | None,
        dt: float,
        root: Array,
        reduced: bool,
        quick: bool = False,
    ) -> None:
        self.plan = plan
        self._names = tuple(names)
        self._solvers = Solvers(backend, quick)
        self._limits = limits
        self._dt = dt
        self._root = root
        self._reduced = reduced and bool(plan.labels[0].equality)
        self._workspace = (reduced, *plan.workspace)

    def solve(
        self, problem: LevelProblem, margins: Bounds | None = None, box: Box | None = None
    ) -> Outcome:
        """Return the lexicographic optimum with rows of margins; outside the limits it is none.

        ``box``: of an earlier round of this tick, None in the first.
        """
        again = box is not None
        box = problem.box if box is None else box
        bounds, held = problem.physics.bounds or margins, problem.contacts
        if problem.physics.bounds is not None and margins is not None:
            bounds = stack([problem.physics.bounds, margins])
        if problem.physics.equalities:
            held = [*problem.physics.equalities, *held]
        qp = self._assemble(problem, problem.rows, held, bounds, box, 0)
        limits = self._limits
        if limits is not None and limits.braking != "bounded":
            limits = None  # a box that always has room needs no second look
        # Other rows than in the round before: there is no warm start, and will be none.
        solution = self._solve_first(qp, once=again, quick=limits is not None)
        spent = solution.solve_time
        if solution.status is not Status.SOLVED and limits is not None:
            gently = partial(self._solvers.solve, workspace=None, quick=True)
            qp = relax_box(qp, limits, problem.snapshot, self._dt, gently) or qp
            solution = self._solve_first(qp, once=True)
            spent += solution.solve_time
        outcome = Outcome(qp, solution, qp, self.plan.decision.nv, spent, {})
        if len(self.plan.levels) > 1:
            outcome = self._descend(problem, held, bounds, outcome)
        return outcome.within_limits(self.plan.decision.names)

    def reduce_singular(
        self, rows: list[Rows], held: Sequence[Rows], level: int
    ) -> tuple[list[Rows], dict[str, Singularity]]:
        """Return all rows, singular ones of a level asking for less, and what they are, by task."""
        members = self.plan.levels[level]
        if not any(rows[k].singular_threshold for k in members):
            return rows, {}
        soft = [rows[k] for k in members if k >= len(self._names)]
        eased, found = reduce_singular([rows[k] for k in members], [*held, *soft], self._root)
        rows = list(rows)
        for k, row in zip(members, eased, strict=True):
            rows[k] = row
        return rows, {self._names[members[k]]: one for k, one in found.items()}

    def solve_relaxed(self, problem: LevelProblem, margins: Sequence[Bounds]) -> Outcome:
        """Return the optimum with all but physics giving way: :mod:`wbc.controllers.relaxation`."""
        rows, contacts, physics = problem.rows, problem.contacts, problem.physics
        relaxed = relaxed_qp(self.plan, rows, contacts, problem.box, margins, physics)
        solution = self._solvers.solve_giving(relaxed)
        missed = given_way(self.plan, contacts, relaxed, solution.x) if solution.solved else None
        qp, spent = relaxed.slackless, solution.solve_time
        return Outcome(qp, solution, qp, self.plan.decision.nv, spent, {}, missed, relaxed)

    def _descend(
        self, problem: LevelProblem, held: list[Rows], bounds: Bounds | None, first: Outcome
    ) -> Outcome:
        """Solve the levels below the first."""
        outcome, rows = first, problem.rows
        active: ActiveSet | None = None
        for level in range(1, len(self.plan.levels)):
            if not outcome.solved:
                break
            x = outcome.solution.x
            achieved = achieved_rows([rows[k] for k in self.plan.levels[level - 1]], x)
            held = [*held, *achieved]
            active = ActiveSet.implied(
                outcome.qp, outcome.solution, achieved, self.plan.decision
            ).union(active)
            above = held[len(problem.physics.equalities) :]
            rows, found = self.reduce_singular(rows, above, level)
            below = self._assemble(problem, rows, held, bounds, first.box, level)
            elimination = eliminate(active.as_equalities(below))
            singular = outcome.singular | found
            if elimination.reduced.g.size == 0:  # the levels above have left nothing to decide
                return outcome._replace(singular=singular)
            solution = self._solve_reduced(elimination, once=True)
            outcome = outcome._replace(
                qp=elimination.full,
                solution=solution,
                solve_time=outcome.solve_time + solution.solve_time,
                singular=singular,
            )
        return outcome

    def _assemble(
        self,
        problem: LevelProblem,
        rows: Sequence[Rows],
        held: Sequence[Rows],
        bounds: Bounds | None,
        box: Box,
        level: int,
    ) -> QP:
        """Return the QP of one level; recovery from violations belongs to the first."""
        if problem.assembled is not None:
            plain = bounds is None and box is problem.box
            return problem.assembled.qp if plain else problem.assembled.bounded(bounds, box)
        plan = self.plan
        costs = rows if len(plan.levels) == 1 else [rows[k] for k in plan.levels[level]]
        if level == 0:
            dominating = [] if problem.recovery is None else [problem.recovery]
            if bounds is not None and bounds.push is not None:
                dominating.insert(0, bounds.push)
            if dominating:
                heaviest = _heaviest(costs)
                costs = [*costs, *(outweighing(extra, heaviest) for extra in dominating)]
        labels, rest = plan.labels[level], problem.physics.rest
        qp = assemble(plan.decision, costs, held, box, bounds, labels, rest)
        if self._limits is None or self._limits.braking == "free":
            return qp
        return scale_gains_to_brake(qp, costs, self._limits, problem.snapshot, self._dt)

    def _solve_first(self, qp: QP, once: bool, quick: bool = False) -> Solution:
        """Solve the first level in the chosen formulation.

        ``once``: without a warm start. ``quick``: what has no solution is relaxed and solved again.
        """
        if self._reduced:
            elimination = eliminate(qp)
            if elimination.reduced.g.size > 0:
                return self._solve_reduced(elimination, once, quick)
        return self._solvers.solve(qp, None if once else self._workspace, quick)

    def _solve_reduced(self, elimination: Elimination, once: bool, quick: bool = False) -> Solution:
        """Solve without the equalities; the answer is that of the full QP, and judged by it."""
        workspace = None if once else self._workspace
        reduced = self._solvers.solve(elimination.reduced, workspace, quick)
        lifted = elimination.lift(reduced)
        if lifted.status is Status.SOLVED and not elimination.admits(lifted):
            return self._solvers.solve(elimination.full, None, quick)
        return lifted


def _heaviest(rows: Sequence[Rows]) -> float:
    """Return the largest square of a weighted row."""
    squared = [np.square(row.matrix).sum(axis=1) * np.square(row.weight) for row in rows]
    return max(float(row.max(initial=0.0)) for row in squared)
