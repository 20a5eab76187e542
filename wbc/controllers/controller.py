"""One control tick, for the velocity and the torque level.

    snapshot -> rows of tasks (goals), contacts (held), limits and margins (safe)
             -> levels: assemble, solve -> look ahead -> within limits? -> tick

The unknown begins with the velocity at the end of the tick. What a level adds, the law that it
applies to tasks, further unknowns and the physics that ties them to the velocity, is said by a
subclass; everything else is written once, here. Between ticks only the solver's warm start is kept,
and at the torque level the last forces and the ramps of those that come and go.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import partial
from time import perf_counter

import numpy as np

from wbc.constraints.limits import Limits
from wbc.constraints.mechanics import mechanics_of
from wbc.constraints.rows import Constraint
from wbc.controllers import parts
from wbc.controllers.conditioning import Conditioning, conditioning
from wbc.controllers.joint_weights import JointWeights, weights_of
from wbc.controllers.level_problem import Box, LevelProblem
from wbc.controllers.levels import FORMULATIONS, LevelSolver, Outcome
from wbc.controllers.look_ahead import Attempt, MarginRows, solve_with_look_ahead
from wbc.controllers.missing_velocity import MissingVelocity
from wbc.controllers.plan import NO_PHYSICS, Decision, Physics, Plan
from wbc.controllers.singular import Singularity
from wbc.controllers.slack import NO_SLACK, Slacks, slacks_of
from wbc.controllers.tick import POLICIES, RELAX, Began, Tick, Times
from wbc.controllers.work import USUAL, units_of
from wbc.errors import ControllerFailure, InvalidInputError
from wbc.laws import Residual, Rows
from wbc.qp.backend import Backend, backend_of
from wbc.qp.solution import Status
from wbc.qp.work import Work
from wbc.robot import Robot, Snapshot
from wbc.tasks.returned import deviation_of, residual_of
from wbc.tasks.sealed import Fixed
from wbc.tasks.task import Task
from wbc.validate import Array, finite_number, read_only, time_step


class Controller(Fixed, ABC):
    """Tasks, contacts, limits and margins as one QP per level and tick.

    Parameters
    ----------
    tasks:
        What to do; names must differ. Their priorities make strict levels, of one QP each. Those
        about forces (:class:`wbc.tasks.ForceTask`) are for the torque level only.
    contacts:
        Tasks that are met exactly, such as frames that are held: :func:`wbc.constraints.support`.
        Left out, a robot with feet floats, and a warning says so; () is to float on purpose.
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
        ``"equality"``: contacts are equality rows. ``"reduced"``: they are eliminated first, to a
        smaller QP with the same optimum (paper eqs. 34-37).
    damping:
        Weight of 1/2 |v|^2 in the cost, [1/(rad/s)^2]: picks one among equally good velocities.
    joint_weights:
        Factors on the damping, 1/2 damping * sum of weight * v^2: a joint of weight 10 moves a
        tenth as much as one of weight 1 that serves as well. By name or pattern (``{"*wrist*": 10,
        "base": 100}``, later entries win, all others 1), or (nv,). They only decide what tasks
        leave open: with a posture task of all joints, nothing.
    on_failure:
        The command when the QP has no solution: ``"hold"`` (zero velocity), ``"damp"`` (half the
        measured velocity, within limits), ``"closest"`` (within limits, least violation of all
        else; some milliseconds) or ``"raise"`` (:class:`~wbc.errors.ControllerFailure`).
    budget:
        Work that a tick may take, counted in units of about a microsecond of a quiet core: see
        :mod:`wbc.controllers.work`. What it does not afford is left out (``tick.left_out``).
        ``"usual"``: 2400, and more for many levels and joints. None: nothing is ever left out.

    Raises
    ------
    InvalidInputError
        A part that is none, was made for another robot, or has the name of another.
    """

    tasks: tuple[Task, ...]
    contacts: tuple[Task, ...]
    constraints: tuple[Constraint, ...]
    budget: float  # units of work of a tick

    _fixed = parts.PLANNED
    _policies: tuple[str, ...] = POLICIES
    _relaxes = False  # whether the level itself relaxes a QP without solution, in bounded time
    _bears = False  # whether the level decides forces
    _going_slack: Mapping[str, float] = NO_SLACK  # of contacts that are leaving

    def __repr__(self) -> str:
        counts = f"{len(self.tasks)} tasks, {len(self.contacts)} contacts"
        counts += f", {len(self.constraints)} constraints"
        return f"{type(self).__name__}({self.robot.name!r}, {counts}, dt={self.dt:g})"

    def __init__(
        self,
        robot: Robot,
        tasks: Sequence[Task],
        *,
        contacts: Sequence[Task] | None = None,
        limits: Limits | None = None,
        constraints: Sequence[Constraint] = (),
        slack: Mapping[str, float] | None = None,
        dt: float = 0.005,
        solver: str | Backend = "proxqp",
        formulation: str = "equality",
        damping: float = 1e-6,
        joint_weights: JointWeights | None = None,
        on_failure: str = "hold",
        budget: float | str | None = USUAL,
    ) -> None:
        contacts, slack = parts.held_by(robot, contacts), NO_SLACK if slack is None else slack
        self.robot, self.limits = robot, limits
        self._take(tasks, contacts, constraints, slack)
        self.dt = time_step("controller", dt)
        self.damping = finite_number("controller, damping", damping, above=0.0)
        self.joint_weights = weights_of(robot, joint_weights)
        self.backend = backend_of(solver)
        self.formulation = parts.one_of("formulation", formulation, FORMULATIONS)
        self._budget = budget
        self.on_failure = parts.one_of("failure policy", on_failure, self._policies)
        self._rest = bytes(8 * robot.nv)  # a velocity of 0
        self._missing_velocity = MissingVelocity(self.dt, damped=self._bears)
        self._no_box = np.full(robot.nv, -np.inf), np.full(robot.nv, np.inf)
        self._plan(tuple(contacts))

    def change(
        self,
        *,
        tasks: Sequence[Task] | None = None,
        contacts: Sequence[Task] | None = None,
        constraints: Sequence[Constraint] | None = None,
        slack: Mapping[str, float] | None = None,
    ) -> None:
        """Change what is done, held and kept from the next tick on; what is left out stays.

        Solvers keep their warm starts for each set of contacts, and at the torque level forces come
        and go without jumps. What :class:`Controller` refuses is refused.
        """
        tasks = self.tasks if tasks is None else tasks
        held = self.contacts if contacts is None else contacts
        constraints = self.constraints if constraints is None else constraints
        slack = self._slack if slack is None else slack
        self._take(tasks, held, constraints, slack)
        # What is held already may be leaving: only contacts that are asked for come back.
        self._plan(tuple(held) if contacts is None else self._next_contacts(tuple(contacts)))

    def set_contacts(self, contacts: Sequence[Task]) -> None:
        """Change what is held: :meth:`change` for contacts alone."""
        parts.check_list("contacts", contacts, Task)  # None would leave them as they are
        self.change(contacts=contacts)

    def step(self, snapshot: Snapshot) -> Tick:
        """Return the command for ``snapshot``.

        Raises
        ------
        InvalidInputError
            Not a snapshot, or one of another robot; or a task or constraint of yours returns
            something else than it should.
        ControllerFailure
            The QP has no solution and the policy is ``raise``.
        """
        if type(snapshot) is not Snapshot or snapshot.robot is not self.robot:
            parts.check_snapshot(self.robot, snapshot)
        try:
            tick = self._step(snapshot)
        except (AttributeError, IndexError, InvalidInputError, TypeError, ValueError):
            parts.look_closely(snapshot, self.dt, self._motion, self.contacts, self.constraints)
            raise
        measured, limits = snapshot.measured, self.limits
        if limits is not None:
            tick.__dict__["_began"] = Began(limits, measured, limits.acceleration, self.dt)
        if measured.endswith(self._rest):
            self._missing_velocity.watch(snapshot, tick.velocity, limits)
        return tick

    def _step(self, snapshot: Snapshot) -> Tick:
        """Return the command."""
        return self._step_within(Work(self.budget), snapshot)

    def _step_within(self, work: Work, snapshot: Snapshot, tried: Attempt | None = None) -> Tick:
        """Return the command: the tick, from top to bottom; ``tried`` is what came of its QP."""
        start = perf_counter()
        # Goals: rows of tasks, then of contacts that may give way.
        residuals, rows, reduce = {}, [], False
        for task in self._motion:
            residual = residual_of(task, snapshot)
            row = self._law(task, residual, snapshot)
            residuals[task.name] = residual
            rows.append(row)
            reduce = reduce or row.singular_threshold > 0.0
        for contact in self.plan.soft:
            row = self._law(contact, residual_of(contact, snapshot), snapshot)
            rows.append(self.slacks.cost(contact, row))
        # Held: contacts, and the physics of what is behind the velocity.
        contacts = self.plan.held.rows(snapshot, self._law)
        physics = self._physics(snapshot)
        rows += physics.forces
        singular: dict[str, Singularity] = {}
        if reduce:
            rows, singular = self._solver.reduce_singular(rows, contacts, level=0, work=work)
        # Safe: limits as a box, margins as rows.
        box, recovery = self._limits_at(snapshot)
        problem = LevelProblem(snapshot, rows, contacts, physics, box, recovery, work)
        margins = None
        if self.constraints and tried is None:
            margins = self._margins(snapshot, work)
        ready = perf_counter()
        attempt = tried or self._attempt(problem, margins)
        if attempt.outcome.solution.status is not Status.SOLVED:
            attempt = self._settle(problem, attempt)
        tick = self._tick(snapshot, physics, residuals, attempt, singular, work, start, ready)
        if tick.policy == "raise":
            raise ControllerFailure(tick.report(), tick)
        return tick

    def conditioning(self, tick: Tick) -> Conditioning:
        """Return how well the tasks determined a tick of this controller: rank and condition."""
        return conditioning(tick.qp, self.damping, self.joint_weights)

    def _take(
        self,
        tasks: Sequence[Task],
        contacts: Sequence[Task],
        constraints: Sequence[Constraint],
        slack: Mapping[str, float],
    ) -> None:
        """Check all parts, and take over all but the contacts."""
        parts.check_parts(self.robot, tasks, contacts, self.limits, constraints, slack)
        if tasks is not self.__dict__.get("tasks"):
            parts.refuse_idle(tasks)
            parts.say_unused_gains(tasks, self._bears)
        kinds = parts.motion_and_forces(tasks, type(self).__name__, self._bears)
        self._motion, self._force_tasks = kinds
        self.__dict__.update(tasks=tuple(tasks), constraints=tuple(constraints))
        self._slack = dict(slack)

    # ------------------------------------------------------------------ what a level says

    def _next_contacts(self, wanted: tuple[Task, ...]) -> tuple[Task, ...]:
        """Return what is held in the next tick if ``wanted`` shall be held from then on."""
        return wanted

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
        """Return the equations that tie the unknowns behind v+ to it."""
        return NO_PHYSICS

    def _limits_at(self, snapshot: Snapshot) -> tuple[Box, Rows | None]:
        """Return the bounds on v+, and rows that move joints back into range, or None."""
        if self.limits is None:
            return self._no_box, None
        return self.limits.box_and_recovery(snapshot, self.dt)

    def _margins(self, snapshot: Snapshot, work: Work) -> MarginRows:
        """Return the rows of the constraints."""
        given = self.constraints, self.slacks, self.dt
        return MarginRows.at(snapshot, *given, work, self._bears)

    def _attempt(self, problem: LevelProblem, margins: MarginRows | None) -> Attempt:
        """Return the optimum with everything kept, if there is one."""
        if margins is None:
            return Attempt(self._solver.solve(problem), [])
        solve = partial(self._solver.solve, problem)
        return solve_with_look_ahead(solve, margins, problem.contacts)

    def _settle(self, problem: LevelProblem, attempt: Attempt) -> Attempt:
        """Return the best attempt where not everything can be kept: here, the one given."""
        return attempt

    # ------------------------------------------------------------------ parts of the tick

    def _plan(self, contacts: tuple[Task, ...]) -> None:
        """Work out what does not change between ticks."""
        self.__dict__["contacts"] = contacts = mechanics_of(self.robot, contacts)
        # Asked in the ticks; all others report their residual's error.
        self._deviating = [t for t in self._motion if type(t).deviation is not Task.deviation]
        self.slacks = Slacks(self._slack, contacts, self.constraints, self._going_slack)
        decision, physics, forces = self._decision(), self._physics_names(), self._force_tasks
        self.plan = Plan.of(decision, self._motion, contacts, self.slacks, physics, forces)
        names, root = [task.name for task in self._motion], np.sqrt(self.joint_weights)
        limits, reduced = None if self._relaxes else self.limits, self.formulation == "reduced"
        self._solver = LevelSolver(
            self.plan, names, self.backend, limits, self.dt, root, reduced, quick=self._relaxes
        )
        self.__dict__["budget"] = units_of(self._budget, self._solver.once)

    def _tick(
        self,
        snapshot: Snapshot,
        physics: Physics,
        residuals: Mapping[str, Residual],
        attempt: Attempt,
        singular: dict[str, Singularity],
        work: Work,
        start: float,
        ready: float,
    ) -> Tick:
        """Turn the attempt into a command, by the declared policy if there is no solution."""
        outcome, _, step_scale = attempt
        solved = outcome.solution.status is Status.SOLVED
        slack: dict[str, float] = {}
        policy = None if solved else self.on_failure
        if not solved:
            velocity, slack = self._fallback(snapshot, outcome, work)
        else:
            velocity = outcome.solution.x[: self.robot.nv]
            if outcome.given_way is not None:
                policy, slack = RELAX, outcome.given_way
            elif outcome.qp.g.size > self.plan.decision.size:
                slack = slacks_of(outcome.qp, outcome.solution.x)
            if step_scale < 1.0:
                velocity = step_scale * velocity
        velocity.setflags(write=False)
        errors = {}
        for name, residual in residuals.items():
            errors[name] = residual.error
        for task in self._deviating:
            errors[task.name] = deviation_of(task, snapshot, residuals[task.name])
        solve = outcome.solve_time
        tick = object.__new__(Tick)
        tick.__dict__.update(  # past __init__, which assigns one frozen field after the other
            velocity=velocity,
            status=outcome.solution.status,
            policy=policy,
            errors=errors,
            solution=outcome.solution,
            times=Times(ready - start, perf_counter() - ready - solve, solve),
            step_scale=step_scale,
            slack=slack,
            singular=singular | outcome.singular,
            left_out=work.left_out,
        )
        if outcome.giving is None:
            tick.__dict__["qp"] = outcome.qp
        else:
            tick.__dict__["_evidence"] = outcome.giving
        return tick

    @abstractmethod
    def _fallback(
        self, snapshot: Snapshot, outcome: Outcome, work: Work
    ) -> tuple[Array, dict[str, float]]:
        """Return the command of the declared policy, within the limits, and the slack it needs."""
