"""The velocity-level controller: one tick, from a snapshot to a joint velocity.

    measurement -> snapshot -> residuals of tasks and contacts -> rows -> QP -> solution -> tick

With constraints such as margins between bodies, the place where the solution leads is looked at
before it becomes the command: see :mod:`wbc.controllers.landing`.

The only memory between ticks is the solver's warm start.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from time import perf_counter

import numpy as np

from wbc.constraints.contact import Contact
from wbc.constraints.held import Held, contact_rows
from wbc.constraints.limits import BASE_ROWS, Limits
from wbc.constraints.rows import Bounds, Constraint
from wbc.controllers.assembly import assemble, slacks
from wbc.controllers.braking import opened, unhurried
from wbc.controllers.conditioning import Conditioning, conditioning
from wbc.controllers.joint_weights import JointWeights, weights_of
from wbc.controllers.landing import Landing
from wbc.controllers.levels import Holding, grouped, kept, level_labels
from wbc.controllers.singular import Singularity, filtered
from wbc.controllers.softness import Softness
from wbc.controllers.tick import POLICIES, Tick, Times
from wbc.errors import ControllerFailure, InvalidInputError, UnknownNameError
from wbc.laws import Rows, velocity_law
from wbc.qp.backend import Backend, make_backend
from wbc.qp.elimination import Elimination, eliminate
from wbc.qp.least_infeasible import least_infeasible
from wbc.qp.problem import QP, Labels
from wbc.qp.solution import Solution, Status
from wbc.robot import Robot, Snapshot
from wbc.tasks.task import Residual, Task
from wbc.validate import Array, finite_number, read_only

FORMULATIONS = ("equality", "reduced")
# Recovery from outside a joint limit outweighs the tasks by this factor (in the squared cost).
RECOVERY_FACTOR = 1e2


class KinematicController:
    """Inverse kinematics by one QP per tick; the unknown is the velocity v.

    Parameters
    ----------
    tasks:
        What to do; names must differ. Their priorities make strict levels, of one QP each.
    contacts:
        Frames that are held; see :func:`wbc.constraints.support`.
    limits:
        Joint and base limits, or None for none.
    constraints:
        What gives inequality rows, such as :class:`wbc.constraints.SelfCollision`.
    slack:
        Contacts (by their frames) and constraints (by their names) that may give way, and the
        weights of that: see :class:`wbc.controllers.softness.Softness`. All others are hard.
    dt:
        Time step [s]: the command is meant to be applied for this long.
    solver:
        A backend, or its name: ``"proxqp"`` or any that qpsolvers finds installed.
    formulation:
        ``"equality"``: contacts are equality rows. ``"reduced"``: they are eliminated first (paper
        eqs. 34-37), which leaves a smaller QP with the same optimum.
    damping:
        Weight of 1/2 |v|^2 in the cost, [1/(rad/s)^2]: picks one among equally good velocities.
    joint_weights:
        Factors on the damping, so that it is 1/2 damping * sum of weight * v^2: a joint of weight
        10 moves a tenth as much as one of weight 1 that serves as well. By name or pattern
        (``{"*wrist*": 10, "base": 100}``, later entries win, all others 1), or (nv,). They decide
        what the tasks leave open, and nothing if a posture task leaves nothing open: give that
        task ``joints``, or raise ``damping`` towards the squares of the tasks' weights.
    on_failure:
        What the command is when the QP has no solution: ``"hold"`` (zero velocity), ``"damp"``
        (half the measured velocity, within limits), ``"closest"`` (within limits, missing the other
        rows by as little as can be; :func:`wbc.qp.least_infeasible.least_infeasible`, some
        milliseconds) or ``"raise"`` (:class:`~wbc.errors.ControllerFailure`).
    """

    def __init__(
        self,
        robot: Robot,
        tasks: Sequence[Task],
        *,
        contacts: Sequence[Contact] = (),
        limits: Limits | None = None,
        constraints: Sequence[Constraint] = (),
        slack: Mapping[str, float] | None = None,
        dt: float = 0.005,
        solver: str | Backend = "proxqp",
        formulation: str = "equality",
        damping: float = 1e-6,
        joint_weights: JointWeights | None = None,
        on_failure: str = "hold",
    ) -> None:
        self.robot = robot
        self.tasks = tuple(tasks)
        self.contacts = tuple(contacts)
        self.limits = limits
        self.constraints = tuple(constraints)
        self.softness = Softness(slack or {}, self.contacts, self.constraints)
        self.dt = finite_number("controller, dt", dt, above=0.0)
        self.damping = finite_number("controller, damping", damping, above=0.0)
        self.joint_weights = weights_of(robot, joint_weights)
        self._damping = read_only(self.damping * self.joint_weights)
        self._root = np.sqrt(self.joint_weights)
        self.backend = make_backend(solver) if isinstance(solver, str) else solver
        self.formulation = _one_of("formulation", formulation, FORMULATIONS)
        self.on_failure = _one_of("failure policy", on_failure, POLICIES)
        self._check_parts()
        self._workspace = (formulation, tuple(contact.labels for contact in self.contacts))
        hard, soft = self.softness.split(self.contacts)
        self._held, self._soft = Held(hard), soft
        # Soft contacts are costs of the first level, behind the tasks.
        first, *lower = grouped(self.tasks)
        behind = range(len(self.tasks), len(self.tasks) + len(soft))
        self._levels = ((*first, *behind), *lower)
        labels = Labels(self._held.labels, (), BASE_ROWS + robot.joint_names)
        costs = (*self.tasks, *soft)
        above = [
            [costs[k] for level in self._levels[:depth] for k in level]
            for depth in range(len(self._levels))
        ]
        self._labels = [level_labels(labels, tasks) for tasks in above]
        unlimited = np.full(robot.nv, np.inf)
        self._no_box = -unlimited, unlimited

    def step(self, snapshot: Snapshot) -> Tick:
        """Return the command for ``snapshot``.

        Raises
        ------
        InvalidInputError
            The snapshot is of another robot.
        ControllerFailure
            The QP has no solution and the policy is ``raise``.
        """
        if snapshot.robot is not self.robot:
            raise InvalidInputError(f"controller: {snapshot!r} is of another robot object")
        start = perf_counter()
        residuals = [task.residual(snapshot) for task in self.tasks]
        rows = self._rows(residuals)
        for contact in self._soft:
            rows.append(self.softness.cost(contact, contact_rows(contact, snapshot, self.dt)))
        equalities = self._held.rows(snapshot, self.dt)
        landing = Landing.of(self.constraints, self.softness, snapshot, self.dt, equalities)
        assembled = perf_counter()
        rows, singular = self._filtered(rows, equalities, level=0)
        box = self._no_box if self.limits is None else self.limits.box(snapshot, self.dt)
        qp = self._qp(snapshot, rows, equalities, landing.bounds, box, level=0)
        ready = perf_counter()
        qp, solution, below = self._descend(qp, snapshot, rows, equalities, landing.bounds)
        nv = self.robot.nv  # behind the velocity there may be slacks
        while landing.breaks(solution.x[:nv]) if solution.solved else landing.yields():
            box = qp.lower[:nv], qp.upper[:nv]  # as far open as it had to be
            qp = self._qp(snapshot, rows, equalities, landing.bounds, box, level=0)
            qp, solution, below = self._descend(qp, snapshot, rows, equalities, landing.bounds)
        share = landing.share(solution.x[:nv]) if solution.solved else 1.0
        times = Times(assembled - start, ready - assembled, perf_counter() - ready)
        return self._answer(snapshot, residuals, qp, solution, share, times, singular | below)

    def conditioning(self, tick: Tick) -> Conditioning:
        """Return how well the tasks determined a tick of this controller: rank and condition."""
        return conditioning(tick.qp, self.damping, self.joint_weights)

    def _descend(
        self,
        qp: QP,
        snapshot: Snapshot,
        rows: list[Rows],
        equalities: list[Rows],
        bounds: Bounds | None,
    ) -> tuple[QP, Solution, dict[str, Singularity]]:
        """Solve the QP of the first level, then those of the levels below, singular tasks held."""
        singular: dict[str, Singularity] = {}
        solution = self._solve(qp)
        if not solution.solved and self.limits is not None:
            gently = partial(self.backend.solve, workspace=(*self._workspace, "braking"))
            wider = opened(qp, self.limits, snapshot, self.dt, gently)
            if wider is not None:
                qp, solution = wider, self._solve(wider)
        if len(self._levels) == 1:
            return qp, solution, singular
        nv, holding = self.robot.nv, None
        box = qp.lower[:nv], qp.upper[:nv]
        damping = float(self._damping.max())
        for level in range(1, len(self._levels)):
            above = [rows[k] for k in self._levels[level - 1]]
            if solution.status is not Status.SOLVED:
                break
            holding = Holding.at(qp, solution, nv, damping).and_of(holding)
            equalities = [*equalities, *kept(above, solution.x)]
            rows, found = self._filtered(rows, equalities, level)
            singular |= found
            below = self._qp(snapshot, rows, equalities, bounds, box, level)
            elimination = eliminate(holding.fasten(below))
            if elimination.reduced.g.size == 0:  # the levels above have left nothing to decide
                break
            qp = elimination.full
            solution = self._solve_reduced(elimination, level)
        return qp, solution, singular

    def _rows(self, residuals: Sequence[Residual]) -> list[Rows]:
        """Apply the velocity law to every task."""
        return [
            velocity_law(
                residual, task.gain, self.dt, task.weight, task.lm_damping, task.singular_below
            )
            for task, residual in zip(self.tasks, residuals, strict=True)
        ]

    def _qp(
        self,
        snapshot: Snapshot,
        rows: list[Rows],
        equalities: list[Rows],
        bounds: Bounds | None,
        box: tuple[Array, Array],
        level: int,
    ) -> QP:
        """Join the costs of a level, equalities (contacts first), inequalities and limits."""
        rows = rows if len(self._levels) == 1 else [rows[k] for k in self._levels[level]]
        dominating = [bounds.push] if bounds is not None and level == 0 else []
        if self.limits is not None and level == 0:
            dominating.append(self.limits.recovery_rows(snapshot, self.dt))
        rows = [*rows, *(_outweighing(extra, rows) for extra in dominating if extra is not None)]
        qp = assemble(rows, equalities, box, bounds, self._labels[level], self._damping)
        if self.limits is None or self.limits.braking == "free":
            return qp
        return unhurried(qp, rows, self.limits, snapshot, self.dt)

    def _filtered(
        self, rows: list[Rows], equalities: list[Rows], level: int
    ) -> tuple[list[Rows], dict[str, Singularity]]:
        """Return all rows, singular ones of a level asking for less, and what they are, by task."""
        members = self._levels[level]
        if not any(rows[k].singular_below for k in members):
            return rows, {}
        soft = [rows[k] for k in members if k >= len(self.tasks)]
        eased, found = filtered([rows[k] for k in members], [*equalities, *soft], self._root)
        rows = list(rows)
        for k, row in zip(members, eased, strict=True):
            rows[k] = row
        return rows, {self.tasks[members[k]].name: one for k, one in found.items()}

    def _solve(self, qp: QP) -> Solution:
        """Solve the first level in the chosen formulation."""
        if self.formulation == "reduced" and self.contacts:
            elimination = eliminate(qp)
            if elimination.reduced.g.size > 0:
                return self._solve_reduced(elimination, level=0)
        return self.backend.solve(qp, workspace=self._workspace)

    def _solve_reduced(self, elimination: Elimination, level: int) -> Solution:
        """Solve without the equalities; the answer is that of the full QP, and judged by it."""
        workspace = (*self._workspace, level)
        lifted = elimination.lift(self.backend.solve(elimination.reduced, workspace=workspace))
        if lifted.status is Status.SOLVED and not elimination.admits(lifted):
            return self.backend.solve(elimination.full, workspace=(*workspace, "full"))
        return lifted

    def _answer(
        self,
        snapshot: Snapshot,
        residuals: Sequence[Residual],
        qp: QP,
        solution: Solution,
        share: float,
        times: Times,
        singular: dict[str, Singularity],
    ) -> Tick:
        """Turn the solution into a command, by the declared policy if there is none."""
        solved = solution.status is Status.SOLVED
        if solved:
            velocity, slack = solution.x[: self.robot.nv], slacks(qp, solution.x)
            if share < 1.0:
                velocity = share * velocity
        else:
            velocity, slack = self._fallback(snapshot, qp)
        tick = Tick(
            velocity=read_only(velocity),
            status=solution.status,
            policy=None if solved else self.on_failure,
            errors={
                task.name: task.deviation(snapshot, residual)
                for task, residual in zip(self.tasks, residuals, strict=True)
            },
            solution=solution,
            qp=qp,
            times=times,
            share=share,
            slack=slack,
            singular=singular,
        )
        if not solved and self.on_failure == "raise":
            raise ControllerFailure(tick.report(), tick)
        return tick

    def _fallback(self, snapshot: Snapshot, qp: QP) -> tuple[Array, dict[str, float]]:
        """Return the command of the declared policy, within the limits' box, and what it misses."""
        nv = self.robot.nv
        if self.on_failure == "closest":
            found = least_infeasible(qp)
            return found.x[:nv], {**slacks(qp, found.x), **found.slack}
        if self.on_failure == "damp":
            return np.clip(0.5 * snapshot.v, qp.lower[:nv], qp.upper[:nv]), {}
        return np.zeros(nv), {}

    def _check_parts(self) -> None:
        """Refuse parts made for another robot, and names given twice."""
        if not self.tasks:
            raise InvalidInputError("controller: no task given; there is nothing to do")
        parts: list[Task | Contact | Limits | Constraint]
        parts = [*self.tasks, *self.contacts, *self.constraints]
        for part in [*parts, *([self.limits] if self.limits else [])]:
            if part.robot is not self.robot:
                raise InvalidInputError(f"controller: {part!r} was made for another robot object")
        for kind, names in (
            ("task", [task.name for task in self.tasks]),
            ("contact", [contact.frame for contact in self.contacts]),
        ):
            for name in names:
                if names.count(name) > 1:
                    raise InvalidInputError(f"controller: two {kind}s are called {name!r}")


def _one_of(kind: str, value: str, choices: Sequence[str]) -> str:
    if value not in choices:
        raise UnknownNameError(kind, value, choices)
    return value


def _outweighing(recovery: Rows, rows: Sequence[Rows]) -> Rows:
    """Return ``recovery`` with a weight that no task row can compete with."""
    squared = [np.square(row.matrix).sum(axis=1) * np.square(row.weight) for row in rows]
    heaviest = max(float(row.max(initial=0.0)) for row in squared)
    weight = np.sqrt(RECOVERY_FACTOR * max(heaviest, 1e-6))
    return recovery._replace(weight=weight * recovery.weight)
