"""Strict priorities: a level may only use the freedom that the levels above it leave.

Level by level a QP is solved; what it achieves for its tasks, ``W J x*``, becomes equality rows for
the next one (lexicographic optimisation, as Kanoun, Lamiraux and Wieber 2011). Limits and contacts
hold on every level, so a lower one can always do what the higher one did: no level is infeasible.
The achieved rows repeat each other and the contacts more often than not, hence below the first
level the equalities are eliminated by a rank-revealing factorisation.

Active bounds of a level that its achieved rows imply stay active below: there they are equalities
(Escande, Mansard and Wieber 2014), since between an achieved row and the bounds that limit it there
is no room, and solvers need an interior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from wbc.constraints.limits import Limits
from wbc.constraints.rows import Bounds
from wbc.controllers.braking import relax_box, scale_gains_to_brake
from wbc.controllers.plan import Decision, Plan, assemble, stacked
from wbc.controllers.singular import Singularity, reduce_singular
from wbc.laws import Rows
from wbc.qp.backend import Backend
from wbc.qp.elimination import RANK_TOLERANCE, Elimination, eliminate
from wbc.qp.problem import QP
from wbc.qp.solution import Solution, Status
from wbc.robot import Snapshot
from wbc.validate import Array

# Recovery from outside a limit or margin outweighs the tasks by this factor (in the squared cost).
RECOVERY_FACTOR = 1e2
# A bound may be implied if its multiplier is so many times what damping can explain.
CANDIDATE = 10.0
# Multipliers of a certificate below this part of the largest count as 0.
CERTAIN = 1e-6

Box = tuple[Array, Array]


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
    """

    qp: QP
    solution: Solution
    first: QP
    nv: int
    solve_time: float
    singular: dict[str, Singularity]

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


class LevelProblem(NamedTuple):
    """Everything that the levels of one tick have in common.

    Attributes
    ----------
    rows:
        One for each task, then for each soft contact.
    held:
        Equality rows: what a level puts first, then the contacts.
    box:
        Bounds (nv,), (nv,) on the velocity.
    recovery:
        Rows that move joints back into range, or None.
    physics:
        Further costs of the first level.
    """

    snapshot: Snapshot
    rows: list[Rows]
    held: list[Rows]
    box: Box
    recovery: Rows | None
    physics: Sequence[Rows] = ()


class LevelSolver:
    """Solves the QPs of all levels of a plan.

    Parameters
    ----------
    root:
        (nv,) square roots of the joints' weights.
    reduced:
        Whether the first level's equalities are eliminated too.
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
    ) -> None:
        self.plan = plan
        self._names = tuple(names)
        self._backend = backend
        self._limits = limits
        self._dt = dt
        self._root = root
        self._reduced = reduced and bool(plan.labels[0].equality)
        self._workspace = (reduced, *plan.workspace)

    def solve(self, problem: LevelProblem, bounds: Bounds | None, box: Box | None) -> Outcome:
        """Return the lexicographic optimum, with more inequality rows or another box on v+."""
        box = problem.box if box is None else box
        qp = self._assemble(problem, problem.rows, problem.held, bounds, box, 0)
        solution = self._solve_first(qp)
        spent = solution.solve_time
        if not solution.solved and self._limits is not None:
            gently = partial(self._backend.solve, workspace=(*self._workspace, "braking"))
            wider = relax_box(qp, self._limits, problem.snapshot, self._dt, gently)
            if wider is not None:
                qp, solution = wider, self._solve_first(wider)
                spent += solution.solve_time
        outcome = Outcome(qp, solution, qp, self.plan.decision.nv, spent, {})
        return outcome if len(self.plan.levels) == 1 else self._descend(problem, bounds, outcome)

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

    def _descend(self, problem: LevelProblem, bounds: Bounds | None, first: Outcome) -> Outcome:
        """Solve the levels below the first."""
        outcome, rows, held = first, problem.rows, problem.held
        active: ActiveSet | None = None
        for level in range(1, len(self.plan.levels)):
            if not outcome.solved:
                break
            x = outcome.solution.x
            achieved = achieved_rows([rows[k] for k in self.plan.levels[level - 1]], x)
            held = [*held, *achieved]
            active = ActiveSet.implied(outcome, achieved, self.plan.decision).union(active)
            rows, found = self.reduce_singular(rows, held, level)
            below = self._assemble(problem, rows, held, bounds, first.box, level)
            elimination = eliminate(active.as_equalities(below))
            singular = outcome.singular | found
            if elimination.reduced.g.size == 0:  # the levels above have left nothing to decide
                return outcome._replace(singular=singular)
            solution = self._solve_reduced(elimination, level)
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
        plan = self.plan
        costs = rows if len(plan.levels) == 1 else [rows[k] for k in plan.levels[level]]
        if level == 0:
            push = None if bounds is None else bounds.push
            dominating = [extra for extra in (push, problem.recovery) if extra is not None]
            if dominating or problem.physics:
                outweighing = [_outweighing(extra, costs) for extra in dominating]
                costs = [*costs, *outweighing, *problem.physics]
        box = plan.decision.box(box)
        qp = assemble(plan.decision, costs, held, box, bounds, plan.labels[level])
        if self._limits is None or self._limits.braking == "free":
            return qp
        return scale_gains_to_brake(qp, costs, self._limits, problem.snapshot, self._dt)

    def _solve_first(self, qp: QP) -> Solution:
        """Solve the first level in the chosen formulation."""
        if self._reduced:
            elimination = eliminate(qp)
            if elimination.reduced.g.size > 0:
                return self._solve_reduced(elimination, level=0)
        return self._backend.solve(qp, workspace=self._workspace)

    def _solve_reduced(self, elimination: Elimination, level: int) -> Solution:
        """Solve without the equalities; the answer is that of the full QP, and judged by it."""
        workspace = (*self._workspace, level)
        lifted = elimination.lift(self._backend.solve(elimination.reduced, workspace=workspace))
        if lifted.status is Status.SOLVED and not elimination.admits(lifted):
            return self._backend.solve(elimination.full, workspace=(*workspace, "full"))
        return lifted


class ActiveSet(NamedTuple):
    """Bounds that the levels so far leave no choice about.

    Attributes
    ----------
    variables, rows:
        (n,) and (mi,) true where the bound of a variable, or an inequality row, is met exactly.
    x:
        (n,) where: the solution of the last level.
    """

    variables: NDArray[np.bool_]
    rows: NDArray[np.bool_]
    x: Array

    @classmethod
    def implied(cls, outcome: Outcome, achieved: Sequence[Rows], decision: Decision) -> ActiveSet:
        """Return the active bounds of a level that its achieved rows imply to be equalities.

        A bound is implied by ``A x = b`` and ``J x = J x*`` if multipliers z > 0 of active bounds
        add up to a combination of these rows. Those of the damped QP do but for the damping's
        part; hence they are projected on the multipliers that do, and bounds that are then not
        pulled at are dropped until none is.

        Parameters
        ----------
        decision:
            The unknowns before the slacks; what their damping explains is not even looked at.
        """
        qp, solution, n = outcome.qp, outcome.solution, decision.size
        x = solution.x
        least = CANDIDATE * float(decision.damping.max()) * float(np.abs(x[:n]).max())
        variables, rows = np.abs(solution.z_box) > least, np.abs(solution.z) > least
        variables[n:] = False
        if x.size > n:  # rows with a slack of their own give way
            rows &= ~qp.C[:, n:].any(axis=1)
        chosen = np.concatenate((np.flatnonzero(variables), x.size + np.flatnonzero(rows)))
        if chosen.size:
            normals = np.concatenate((np.eye(n)[variables[:n]], qp.C[rows, :n]))
            lengths = np.linalg.norm(normals, axis=1)
            pull = np.concatenate((solution.z_box[variables], solution.z[rows]))
            held = stacked([qp.A[:, :n], *(row.matrix for row in achieved)], n)
            signed = (np.copysign(1.0, pull) / lengths)[:, None] * normals
            kept = _positive_kernel(_beside(held, signed), lengths * np.abs(pull))
            dropped = np.delete(chosen, kept)
            variables[dropped[dropped < x.size]] = False
            rows[dropped[dropped >= x.size] - x.size] = False
        return cls(variables, rows, x)

    def union(self, above: ActiveSet | None) -> ActiveSet:
        """Return these together with those of the levels above."""
        if above is None:
            return self
        return ActiveSet(self.variables | above.variables, self.rows | above.rows, self.x)

    def as_equalities(self, qp: QP) -> QP:
        """Return the QP of the next level with these bounds as equalities.

        What the level above missed of other rows and bounds by rounding, this one misses too: so
        it can always do what that one did, however little is left free.
        """
        values = qp.C @ self.x
        A = np.concatenate((qp.A, np.eye(qp.g.size)[self.variables], qp.C[self.rows]))
        every = (*qp.labels.variables, *qp.labels.inequality)
        met = (*self.variables.tolist(), *self.rows.tolist())
        names = tuple(name for name, one in zip(every, met, strict=True) if one)
        return replace(
            qp,
            A=A,
            b=A @ self.x,
            lower=np.where(self.variables, -np.inf, np.minimum(qp.lower, self.x)),
            upper=np.where(self.variables, np.inf, np.maximum(qp.upper, self.x)),
            l=np.where(self.rows, -np.inf, np.minimum(qp.l, values)),
            u=np.where(self.rows, np.inf, np.maximum(qp.u, values)),
            labels=replace(qp.labels, equality=qp.labels.equality + names),
        )


def achieved_rows(rows: Sequence[Rows], x: Array) -> list[Rows]:
    """Return equality rows that keep what ``x`` achieves for ``rows``; weightless rows are free."""
    held = []
    for row in rows:
        weighted = row.weight > 0.0
        matrix = row.matrix[weighted]
        held.append(Rows(matrix, matrix @ x[: matrix.shape[1]], np.ones(len(matrix))))
    return held


def _outweighing(recovery: Rows, rows: Sequence[Rows]) -> Rows:
    """Return ``recovery`` with a weight that no task row can compete with."""
    squared = [np.square(row.matrix).sum(axis=1) * np.square(row.weight) for row in rows]
    heaviest = max(float(row.max(initial=0.0)) for row in squared)
    weight = np.sqrt(RECOVERY_FACTOR * max(heaviest, 1e-6))
    return recovery._replace(weight=weight * recovery.weight)


def _beside(held: Array, vectors: Array) -> Array:
    """Return vectors (m, n) less their parts in the row space of ``held`` (k, n)."""
    if not held.size:
        return vectors
    lengths = np.linalg.norm(held, axis=1)
    unit = held[lengths > 0.0] / lengths[lengths > 0.0, None]
    packed, _, tau, _, _ = lapack.dgeqp3(unit.T)
    diagonal = np.abs(np.diagonal(packed))
    rank = int(np.count_nonzero(diagonal > RANK_TOLERANCE * diagonal[0]))
    Q, _, _ = lapack.dorgqr(packed[:, : tau.size], tau)
    basis = Q[:, :rank]
    return vectors - (vectors @ basis) @ basis.T


def _positive_kernel(vectors: Array, guess: Array) -> NDArray[np.int64]:
    """Return which vectors (m, n) take part in a combination ``z @ vectors = 0``, z > 0.

    The nearest such combination to ``guess`` (m,) is sought; all those returned do take part in
    one, but others may too.
    """
    kept = np.arange(len(vectors))
    while kept.size:
        inverse = np.linalg.pinv(vectors[kept].T, rcond=CERTAIN)
        z = guess[kept] - inverse @ (vectors[kept].T @ guess[kept])
        enough = z > CERTAIN * max(float(guess[kept].max()), 0.0)
        if enough.all():
            break
        kept = kept[enough]
    return kept
