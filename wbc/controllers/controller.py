"""One control tick, for the velocity and the torque level.

    snapshot -> rows of tasks (goals), contacts (held), limits and margins (safe)
             -> levels: assemble, solve -> look ahead -> check -> tick

The unknown begins with the velocity at the end of the tick. What a level adds, the law that it
applies to tasks, further unknowns and the physics that ties them to the velocity, is said by a
subclass; everything else is written once, here. The only memory between ticks is the solver's warm
start.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from typing import NamedTuple

import numpy as np

from wbc.constraints.limits import Limits
from wbc.constraints.rows import Bounds, Constraint, stack
from wbc.controllers.conditioning import Conditioning, conditioning
from wbc.controllers.joint_weights import JointWeights, weights_of
from wbc.controllers.levels import LevelProblem, LevelSolver, Outcome
from wbc.controllers.look_ahead import MarginRows, solve_with_look_ahead
from wbc.controllers.parts import check_parts, check_residual, one_of
from wbc.controllers.plan import Decision, Plan
from wbc.controllers.singular import Singularity
from wbc.controllers.slack import Slacks, slacks_of
from wbc.controllers.tick import POLICIES, Tick, Times
from wbc.errors import ControllerFailure, InvalidInputError
from wbc.laws import Residual, Rows
from wbc.qp.backend import Backend, make_backend
from wbc.qp.least_infeasible import least_infeasible
from wbc.qp.solution import Status
from wbc.robot import Robot, Snapshot
from wbc.tasks.task import Task
from wbc.validate import Array, finite_number, read_only

FORMULATIONS = ("equality", "reduced")
# A command may exceed a bound of its box by this [rad/s or m/s]: what accepted solutions leave.
TOLERANCE = 1e-6


class Physics(NamedTuple):
    """What ties the unknowns behind v+ to it at one snapshot: nothing at the velocity level.

    Attributes
    ----------
    equalities:
        Rows (k, n) met exactly, in the order of the names given by ``_physics_names``.
    bounds:
        Inequality rows (m, n), such as friction cones; None for none.
    costs:
        Rows added to the first level.
    """

    equalities: Sequence[Rows] = ()
    bounds: Bounds | None = None
    costs: Sequence[Rows] = ()


NO_PHYSICS = Physics()


class Controller(ABC):
    """Tasks, contacts, limits and margins as one QP per level and tick.

    Parameters
    ----------
    tasks:
        What to do; names must differ. Their priorities make strict levels, of one QP each.
    contacts:
        Tasks that are met exactly, such as frames that are held: :func:`wbc.constraints.support`.
    limits:
        Joint and base limits, or None for none.
    constraints:
        What gives inequality rows, such as :class:`wbc.constraints.SelfCollision`.
    slack:
        Contacts (by their frames) and constraints (by their names) that may give way, and the
        weights of that: see :class:`wbc.controllers.slack.Slacks`. All others are hard.
    dt:
        Time step [s]: the command is meant to be applied for this long.
    solver:
        A backend, or its name: ``"proxqp"`` or any that qpsolvers finds installed. Controllers that
        share a backend share its warm starts, one for each set of contacts.
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

    Raises
    ------
    InvalidInputError
        A part that is none, was made for another robot, or has the name of another.
    """

    def __init__(
        self,
        robot: Robot,
        tasks: Sequence[Task],
        *,
        contacts: Sequence[Task] = (),
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
        check_parts(robot, tasks, contacts, limits, constraints)
        self.robot = robot
        self.tasks = tuple(tasks)
        self.limits = limits
        self.constraints = tuple(constraints)
        self.dt = finite_number("controller, dt", dt, above=0.0)
        self.damping = finite_number("controller, damping", damping, above=0.0)
        self.joint_weights = weights_of(robot, joint_weights)
        self.backend = make_backend(solver) if isinstance(solver, str) else solver
        self.formulation = one_of("formulation", formulation, FORMULATIONS)
        self.on_failure = one_of("failure policy", on_failure, POLICIES)
        unlimited = np.full(robot.nv, np.inf)
        self._no_box = read_only(-unlimited), read_only(unlimited)
        self._slack = dict(slack or {})
        self.contacts: tuple[Task, ...] = ()
        self._plan(tuple(contacts))

    def set_contacts(self, contacts: Sequence[Task]) -> None:
        """Change what is held; solvers keep their warm starts for each set of contacts.

        Raises
        ------
        InvalidInputError
            As when the controller is made.
        """
        check_parts(self.robot, self.tasks, contacts, self.limits, self.constraints)
        self._plan(tuple(contacts))

    def step(self, snapshot: Snapshot) -> Tick:
        """Return the command for ``snapshot``.

        Raises
        ------
        InvalidInputError
            Not a snapshot, or one of another robot; or a task returned something else than its
            residual.
        ControllerFailure
            The QP has no solution and the policy is ``raise``.
        """
        if not isinstance(snapshot, Snapshot) or snapshot.robot is not self.robot:
            raise InvalidInputError(
                f"controller: expected a snapshot of {self.robot.name}, made by the robot object "
                f"that the controller was made with; got {snapshot!r}"
            )
        start = perf_counter()
        # Goals: rows of tasks, then of contacts that may give way.
        residuals = [task.residual(snapshot) for task in self.tasks]
        rows = [
            self._law(task, check_residual(task, residual, self.robot.nv), snapshot)
            for task, residual in zip(self.tasks, residuals, strict=True)
        ]
        for contact in self.plan.soft:
            rows.append(self.slacks.cost(contact, self._contact_rows(contact, snapshot)))
        # Held: contacts, and the physics of what is behind the velocity.
        contacts = self.plan.held
        held = contacts.select([self._contact_rows(one, snapshot) for one in contacts.contacts])
        physics = self._physics(snapshot)
        rows, singular = self._solver.reduce_singular(rows, held, level=0)
        # Safe: limits as a box, margins as rows.
        box, recovery = self._no_box, None
        if self.limits is not None:
            box, recovery = self.limits.box_and_recovery(snapshot, self.dt)
        problem = LevelProblem(
            snapshot, rows, [*physics.equalities, *held], box, recovery, physics.costs
        )
        margins = MarginRows.at(snapshot, self.constraints, self.slacks, self.dt)
        ready = perf_counter()

        def solve(bounds: Bounds | None, box: tuple[Array, Array] | None = None) -> Outcome:
            parts = [part for part in (physics.bounds, bounds) if part is not None]
            return self._solver.solve(problem, stack(parts) if parts else None, box)

        if self.constraints:
            outcome, step_scale = solve_with_look_ahead(solve, margins, held)
        else:
            outcome, step_scale = solve(None), 1.0
        outcome = self._checked(outcome)
        spent = perf_counter() - ready
        times = Times(ready - start, spent - outcome.solve_time, outcome.solve_time)
        tick = self._tick(snapshot, residuals, outcome, step_scale, times, singular)
        if not tick.ok and self.on_failure == "raise":
            raise ControllerFailure(tick.report(), tick)
        return tick

    def conditioning(self, tick: Tick) -> Conditioning:
        """Return how well the tasks determined a tick of this controller: rank and condition."""
        return conditioning(tick.qp, self.damping, self.joint_weights)

    # ------------------------------------------------------------------ what a level says

    @abstractmethod
    def _law(self, task: Task, residual: Residual, snapshot: Snapshot) -> Rows:
        """Return the rows on v+ by which the level drives a task."""

    def _decision(self) -> Decision:
        """Return the unknowns."""
        return Decision.velocity(self.robot, read_only(self.damping * self.joint_weights))

    def _physics_names(self) -> tuple[str, ...]:
        """Return the names of the equality rows of :meth:`_physics`."""
        return ()

    def _physics(self, snapshot: Snapshot) -> Physics:
        """Return what ties the unknowns behind v+ to it."""
        return NO_PHYSICS

    # ------------------------------------------------------------------ parts of the tick

    def _plan(self, contacts: tuple[Task, ...]) -> None:
        """Work out what does not change between ticks."""
        self.contacts = contacts
        self.slacks = Slacks(self._slack, contacts, self.constraints)
        self.plan = Plan.of(
            self._decision(), self.tasks, contacts, self.slacks, self._physics_names()
        )
        self._solver = LevelSolver(
            self.plan,
            [task.name for task in self.tasks],
            self.backend,
            self.limits,
            self.dt,
            np.sqrt(self.joint_weights),
            self.formulation == "reduced",
        )

    def _contact_rows(self, contact: Task, snapshot: Snapshot) -> Rows:
        residual = check_residual(contact, contact.residual(snapshot), self.robot.nv)
        return self._law(contact, residual, snapshot)

    def _checked(self, outcome: Outcome) -> Outcome:
        """Refuse a solution outside the limits in the robot's own units, whatever it rests on.

        Residuals are judged relative to the numbers of the QP, which may be huge; joints are not.
        """
        if not outcome.solved:
            return outcome
        lower, upper = outcome.box
        v = outcome.velocity
        excess = np.maximum(lower - v, v - upper)
        worst = int(excess.argmax())
        if excess[worst] <= TOLERANCE:  # NaN is not
            return outcome
        solution = replace(
            outcome.solution,
            status=Status.CONTRADICTED,
            message=(
                f"{self.plan.decision.names[worst]} at {v[worst]:.6g}, outside its limits "
                f"[{lower[worst]:.6g}, {upper[worst]:.6g}]: not commanded"
            ),
        )
        return outcome._replace(solution=solution)

    def _tick(
        self,
        snapshot: Snapshot,
        residuals: Sequence[Residual],
        outcome: Outcome,
        step_scale: float,
        times: Times,
        singular: dict[str, Singularity],
    ) -> Tick:
        """Turn the outcome into a command, by the declared policy if there is no solution."""
        solved = outcome.solved
        if solved:
            velocity, slack = outcome.velocity, slacks_of(outcome.qp, outcome.solution.x)
            if step_scale < 1.0:
                velocity = step_scale * velocity
        else:
            velocity, slack = self._fallback(snapshot, outcome)
        return Tick(
            velocity=read_only(velocity),
            status=outcome.solution.status,
            policy=None if solved else self.on_failure,
            errors={
                task.name: task.deviation(snapshot, residual)
                for task, residual in zip(self.tasks, residuals, strict=True)
            },
            solution=outcome.solution,
            qp=outcome.qp,
            times=times,
            step_scale=step_scale,
            slack=slack,
            singular=singular | outcome.singular,
        )

    def _fallback(self, snapshot: Snapshot, outcome: Outcome) -> tuple[Array, dict[str, float]]:
        """Return the command of the declared policy, within the limits' box, and what it misses."""
        nv = self.robot.nv
        if self.on_failure == "closest":
            qp = outcome.first
            found = least_infeasible(qp)
            return found.x[:nv], {**slacks_of(qp, found.x), **found.slack}
        if self.on_failure == "damp":
            return np.clip(0.5 * snapshot.v, *outcome.box), {}
        return np.zeros(nv), {}
