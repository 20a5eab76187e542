"""One control tick, for the velocity and the torque level.

    snapshot -> rows of tasks (goals), contacts (held), limits and margins (safe)
             -> levels: assemble, solve -> look ahead -> within limits? -> tick

The unknowns begin with the velocity at the end of the tick. Subclasses add their control level:
the tasks' law, further unknowns, and the physics that ties these to the velocity. Between ticks
only the solver's warm start is kept, and at the torque level the last forces and their ramps.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any, Never, Self

import numpy as np

from wbc.attributes import DeclaredAttributes
from wbc.constraints.collision import SelfCollision
from wbc.constraints.limits import Box, Limits
from wbc.constraints.mechanics import mechanics_of
from wbc.constraints.rows import Bounds, Constraint
from wbc.controllers import checks
from wbc.controllers.blocks import TaskEvaluation
from wbc.controllers.conditioning import Conditioning, conditioning
from wbc.controllers.contact_forces import NO_RAMPS
from wbc.controllers.core_plan import CorePlan, core_solves
from wbc.controllers.core_tick import CoreTick
from wbc.controllers.first_level import FirstLevel
from wbc.controllers.force_rows import TorqueRows
from wbc.controllers.joint_weights import JointWeights, weights_of
from wbc.controllers.known_plans import KnownPlans
from wbc.controllers.levels import Levels
from wbc.controllers.look_ahead import MarginRows, Solve, solve_with_look_ahead
from wbc.controllers.margin_rows import only_self_collision
from wbc.controllers.missing_velocity import MissingVelocity
from wbc.controllers.outcome import Outcome
from wbc.controllers.plan import Decision, LevelPlan
from wbc.controllers.slack import NO_SLACK, Slacks
from wbc.controllers.tick import POLICIES, Tick
from wbc.errors import ControllerFailure, InvalidInputError, no_attribute
from wbc.kinds import check_kind, one_of
from wbc.laws import Rows
from wbc.qp.backend import Backend, backend_of
from wbc.robot import Robot, Snapshot
from wbc.tasks.task import Task
from wbc.tasks.validation import deviation_of, drift_of, residual_of
from wbc.validate import Array, finite_number, read_only, time_step

COMPETING_CHECK_FROM = 128  # ticks after which a robot may be at rest, its tasks competing
Evaluate = Callable[[CorePlan], list[TaskEvaluation]]


class Controller(DeclaredAttributes, ABC):
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
        A backend, or its name: ``"proxqp"``; ``"active_set"``, the core's own method, which takes
        half of the time where bounds are active; or any that qpsolvers finds installed. Controllers
        that share a backend share its warm starts, one for each set of contacts.
    damping:
        Weight of 1/2 |v|^2 in the cost, [1/(rad/s)^2]: picks one among equally good velocities.
    joint_weights:
        Factors on the damping, 1/2 damping * sum of weight * v^2: a joint of weight 10 moves a
        tenth as much as one of weight 1 that serves as well. By name or pattern (``{"*wrist*":
        10, "base": 100}``, later entries win, all others 1), or (nv,). They only decide what tasks
        leave open: with a posture task of all joints, nothing.
    deadline:
        Time that a tick may take [s], or None. Once it is over the best command within limits is
        returned: nothing is solved again, and what was left out is said (``tick.left_out``).
    on_failure:
        The command when the QP has no solution: ``"hold"`` (zero velocity), ``"damp"`` (half the
        measured velocity, within limits), ``"closest"`` (within limits, least violation of all
        else; some milliseconds) or ``"raise"`` (:class:`~wbc.errors.ControllerFailure`).

    Raises
    ------
    InvalidInputError
        A part that is none, was made for another robot, or has the name of another.
    """

    robot: Robot
    limits: Limits | None
    dt: float
    damping: float
    joint_weights: Array
    backend: Backend
    on_failure: str
    plan: LevelPlan
    slacks: Slacks
    tasks: tuple[Task, ...]
    contacts: tuple[Task, ...]
    constraints: tuple[Constraint, ...]
    deadline: float | None
    ticks: int  # number of calls of step()
    _core: CorePlan
    _second_core: CorePlan | None  # without margins, if the first has them; made on demand
    _curved_tasks: frozenset[str]  # tasks in Python whose residuals have a curvature
    _error_offset: Array  # (held,) added to the errors of loops and gears

    _fixed = checks.FIXED
    _planned: tuple[str, ...] = (  # attributes that a plan sets
        *("contacts", "slacks", "plan", "_levels", "_error_offset", "_curved_tasks"),
        *("_second_core", "_margins_in_core", "_core", "_deviating", "_core_suffices"),
    )
    _policies: tuple[str, ...] = POLICIES
    _warned_competing = False
    _decides_forces = False  # True at the torque level
    _leaving_slack: Mapping[str, float] = NO_SLACK  # slack weights of contacts being released
    _ramp_limits: Mapping[str, float] = NO_RAMPS  # normal force bounds of ramping contacts [N]

    def __repr__(self) -> str:
        counts = f"{len(self.tasks)} tasks, {len(self.contacts)} contacts"
        counts += f", {len(self.constraints)} constraints"
        return f"{type(self).__name__}({self.robot.name!r}, {counts}, dt={self.dt:g})"

    def __init__(
        self,
        robot: Robot,
        tasks: Sequence[Task],
        *more: Never,
        contacts: Sequence[Task] | None = None,
        limits: Limits | None = None,
        constraints: Sequence[Constraint] = (),
        slack: Mapping[str, float] | None = None,
        dt: float = 0.005,
        solver: str | Backend = "proxqp",
        damping: float = 1e-6,
        joint_weights: JointWeights | None = None,
        on_failure: str = "hold",
        deadline: float | None = None,
    ) -> None:
        checks.refuse_positional(more)
        contacts = checks.contacts_or_warn(robot, contacts)
        slack = NO_SLACK if slack is None else slack
        self.robot, self.limits, self.ticks = robot, limits, 0
        self._set_parts(tasks, contacts, constraints, slack)
        self.dt = time_step("controller", dt)
        self.damping = finite_number("controller, damping", damping, above=0.0)
        self.joint_weights = weights_of(robot, joint_weights)
        self.backend = backend_of(solver)
        self.on_failure, self.deadline = on_failure, deadline
        self._rest = bytes(8 * robot.nv)  # a velocity of 0
        self._missing_velocity = MissingVelocity(self.dt, damped=self._decides_forces)
        self._known_plans = KnownPlans()
        self._plan(tuple(contacts))

    def __copy__(self) -> Self:
        """Return a controller of the same robot, tasks and constraints, with its own state."""
        parts = self.robot, self.limits, *self.tasks, *self.contacts, *self.constraints
        return deepcopy(self, {id(part): part for part in parts})

    def _set_attribute(self, name: str, value: Any) -> None:
        if name == "on_failure":
            value = one_of("failure policy", value, self._policies)
        elif name == "deadline" and value is not None:
            value = finite_number("controller, deadline", value, above=0.0)
        super()._set_attribute(name, value)

    def change(
        self,
        *,
        tasks: Sequence[Task] | None = None,
        contacts: Sequence[Task] | None = None,
        constraints: Sequence[Constraint] | None = None,
        slack: Mapping[str, float] | None = None,
    ) -> None:
        """Replace tasks, contacts, constraints or slack from the next tick on; others stay.

        Solvers keep their warm starts for each set of contacts, and at the torque level forces ramp
        up and down. Raises what :class:`Controller` raises, and nothing is changed then.
        """
        with self._unchanged_if_refused():
            tasks = self.tasks if tasks is None else tasks
            held = self.contacts if contacts is None else contacts
            constraints = self.constraints if constraints is None else constraints
            slack = self._slack if slack is None else slack
            self._set_parts(tasks, held, constraints, slack)
            self._known_plans = KnownPlans()
            # self.contacts may include some that are being released: only given ones come back.
            self._plan(tuple(held) if contacts is None else self._next_contacts(tuple(contacts)))

    @contextmanager
    def _unchanged_if_refused(self) -> Iterator[None]:
        """Put the controller back to what it is if the change meanwhile raises.

        Some parts are refused only where the plan is made, when others are changed already.
        """
        before = dict(self.__dict__)
        try:
            yield
        except Exception:
            self.__dict__.clear()
            self.__dict__.update(before)
            raise

    def set_contacts(self, contacts: Sequence[Task]) -> None:
        """Replace the contacts: :meth:`change` for contacts alone.

        The same objects that were held before need no new plan, which takes a millisecond, wherever
        they are anchored now (:meth:`~wbc.constraints.Contact.move_to`). Line contacts, several on
        one link, and those of classes of your own do.
        """
        self._check_contacts(contacts)
        with self._unchanged_if_refused():
            self._plan_for(self._next_contacts(tuple(contacts)))

    def _check_contacts(self, contacts: Sequence[Task]) -> None:
        """Refuse what are no contacts, unless they were held before."""
        checks.check_list("contacts", contacts, Task)
        if self._known_plans.find(contacts, NO_SLACK) is None:
            parts = self.robot, self.tasks, contacts, self.limits, self.constraints, self._slack
            checks.check_parts(*parts)

    if not TYPE_CHECKING:  # for checkers there is none

        @property
        def solve(self):
            """What other libraries call :meth:`step`."""
            raise no_attribute(f"{type(self).__name__!r} object", "solve", ["step"])

    def step(self, snapshot: Snapshot, wrenches: None = None) -> Tick:
        """Return the command for ``snapshot``; wrenches are of the torque level.

        Raises
        ------
        InvalidInputError
            Not a snapshot, or one of another robot; or a task or constraint of yours returns
            something else than it should.
        ControllerFailure
            The QP has no solution and the policy is ``raise``.
        """
        if (
            wrenches is not None
            or type(snapshot) is not Snapshot
            or snapshot.robot is not self.robot
        ):
            checks.check_snapshot(self.robot, snapshot, wrenches)
        own, before = self.__dict__, self._memory()
        own["ticks"] = number = own["ticks"] + 1
        measured, limits = snapshot.measured, self.limits
        fast = None if limits is None else limits.acceleration
        began = limits, measured, fast, self.dt, self, before, number  # see TickOrigin
        try:
            tick = self._step(snapshot)
        except ControllerFailure as failure:
            if isinstance(failure.tick, Tick):
                failure.tick.__dict__["_origin"] = began
            raise
        except (AttributeError, IndexError, InvalidInputError, TypeError, ValueError):
            checks.validate_returns(
                snapshot, self.dt, self._motion, self.contacts, self.constraints
            )
            raise
        tick.__dict__["_origin"] = began
        if not number & (number - 1):  # the first tick, the second, fourth, eighth...
            self._log_advice(snapshot, tick, number)
        if measured.endswith(self._rest):
            self._missing_velocity.watch(snapshot, tick.velocity, limits)
        return tick

    def _log_advice(self, snapshot: Snapshot, tick: Tick, number: int) -> None:
        """Log likely mistakes; called rarely, it takes as long as a tick."""
        if number == 1:
            if not checks.warn_outside_limits(snapshot):
                checks.warn_far_targets(self._motion, tick.errors)
            checks.warn_displaced(snapshot, self.contacts)
            checks.warn_forceless(self._force_tasks, self.contacts)
            if self._decides_forces:
                checks.warn_dependent(snapshot, self.contacts)
        elif (
            number >= COMPETING_CHECK_FROM
            and tick.ok
            and not (self._decides_forces or self._warned_competing)
        ):
            parts = self._motion, snapshot, tick.velocity, self.dt
            self._warned_competing = checks.warn_competing(*parts)

    def _step(self, snapshot: Snapshot) -> Tick:
        """Return the command: by the core alone if it can, else with decisions in Python."""
        start_time, plan, core_tick = perf_counter(), self._core, None
        if not plan.is_current(self.limits, self.dt):
            self._plan(self.contacts)
        elif self._core_suffices:
            core_tick = plan.tick(snapshot, (), None, self._ramp_limits, start_time)
            if core_tick is not None and core_tick.is_whole:
                return self._command(snapshot, core_tick)
        return self._step_in_python(snapshot, start_time, core_tick)

    def _step_in_python(
        self, snapshot: Snapshot, start_time: float, core_tick: CoreTick | None = None
    ) -> Tick:
        """Return the command of a tick that the core alone does not solve.

        ``core_tick``: the core's attempt, if it made one: unsolved, or without its last levels.
        """
        if self._margins_in_core or not self.constraints:
            evaluate = self._evaluate_once(snapshot)
            outcome = self._solve(snapshot, self._core, None, None, start_time, evaluate, core_tick)
            # A replan meanwhile may have taken the margin out of the core.
            if not self.constraints or (outcome.solved and self._margins_in_core):
                return self._answer(snapshot, outcome, [])
        # Constraints in Python; or the core's QP is unsolved, or its solution ends inside a margin.
        margins = self._margins(snapshot)
        outcome, rows = self._solve_with_margins(snapshot, margins, start_time)
        return self._answer(snapshot, outcome, rows)

    def _solve(
        self,
        snapshot: Snapshot,
        plan: CorePlan,
        bounds: Bounds | None,
        box: Box | None,
        start_time: float,
        evaluate: Evaluate,
        core_tick: CoreTick | None = None,
        relaxed: bool = False,
    ) -> Outcome:
        """Solve all levels with inequality rows of constraints in Python.

        ``box``: on v+, from an earlier round of this tick; None in the first. ``relaxed``: whether
        the box was relaxed in this round. ``evaluate``: returns the residuals of tasks in Python,
        the same in all rounds.
        """
        levels = self._levels
        if not levels.bounds_braking:
            box = None  # the limits' box, in each round
        simple = box is None and not levels.modifies_qps
        if core_tick is None:
            parts = evaluate(plan), bounds, self._ramp_limits
            core_tick = plan.tick(snapshot, *parts, start_time, simple)
            if core_tick is None:
                plan = self._replan(plan, evaluate(plan))
                return self._solve(snapshot, plan, bounds, box, start_time, evaluate)
        if core_tick.is_whole:
            return Outcome(core_tick)
        deadline_over = self._deadline_over(start_time)
        outcome = levels.solve(plan, core_tick, snapshot, box, simple, deadline_over)
        if not outcome.solved and not relaxed and levels.bounds_braking:
            wider = levels.relaxed_box(core_tick, snapshot)
            if wider is not None:
                given = plan, bounds, wider, start_time, evaluate
                return self._solve(snapshot, *given, relaxed=True)
        return outcome

    @property
    def _core_without_margins(self) -> CorePlan:
        """The plan without margins in the core: Python adds their rows."""
        if not self._margins_in_core:
            return self._core
        if self._second_core is None:  # few ticks need it, and each change of contacts replans
            self._second_core = self._core_plan(None, self._curved_tasks)
        return self._second_core

    def _replan(self, plan: CorePlan, evaluations: Sequence[TaskEvaluation]) -> CorePlan:
        """Plan again as tasks have changed in kind or size; return the successor of ``plan``."""
        margins_in_plan = self._margins_in_core and plan is not self._second_core
        residuals = ((one.task.name, one.residual) for one in evaluations)
        curved = (name for name, one in residuals if one is not None and one.curvature is not None)
        self._plan(self.contacts, frozenset(curved))
        return self._core if margins_in_plan else self._core_without_margins

    def _assemble(self, snapshot: Snapshot, start_time: float) -> CoreTick:
        """Return a tick whose first QP is set up, without margins, and not solved."""
        plan = self._core_without_margins
        found = self._evaluate_python_tasks(plan, snapshot)
        core_tick = plan.tick(snapshot, found, None, self._ramp_limits, start_time, solve=False)
        if core_tick is None:
            self._replan(plan, found)
            return self._assemble(snapshot, start_time)
        return core_tick

    def _deadline_over(self, start_time: float) -> bool:
        """Return whether the deadline of a tick is over."""
        return self.deadline is not None and perf_counter() - start_time > self.deadline

    def _evaluate_once(self, snapshot: Snapshot) -> Evaluate:
        """Return a function that evaluates a plan's tasks in Python, once in a tick."""
        cache: dict[CorePlan, list[TaskEvaluation]] = {}

        def evaluate(plan: CorePlan) -> list[TaskEvaluation]:
            if plan not in cache:
                cache[plan] = self._evaluate_python_tasks(plan, snapshot)
            return cache[plan]

        return evaluate

    def _evaluate_python_tasks(self, plan: CorePlan, snapshot: Snapshot) -> list[TaskEvaluation]:
        """Evaluate the tasks and contacts that the core does not know."""
        found = []
        for task in plan.python_tasks:
            residual = residual_of(task, snapshot)
            drift = drift_of(task, snapshot) if self._decides_forces else None
            found.append(TaskEvaluation(task, residual, drift))
        return found

    def _extra_fields(self, outcome: Outcome, snapshot: Snapshot) -> dict[str, Any]:
        """Return the fields of a tick that are not read from the core."""
        known: dict[str, Any] = {}
        if outcome.step_scale < 1.0:
            known["step_scale"] = outcome.step_scale
        return known | self._errors(outcome.core_tick, snapshot)

    def _errors(self, core_tick: CoreTick, snapshot: Snapshot) -> dict[str, Any]:
        """Return the tasks' errors if some are not their residuals' (:meth:`Task.deviation`)."""
        if not self._deviating:
            return {}
        errors = dict(core_tick.errors)
        for task in self._deviating:
            errors[task.name] = deviation_of(task, snapshot, core_tick.residual(task.name))
        return {"errors": errors}

    def _fallback_fields(self, outcome: Outcome, snapshot: Snapshot) -> dict[str, Any]:
        """Return the fields of a tick without a solution, by the declared policy."""
        velocity, slack = self._fallback(snapshot, outcome)
        velocity.setflags(write=False)
        known = {"errors": outcome.core_tick.errors} | self._extra_fields(outcome, snapshot)
        solution = outcome.solution
        return known | {
            "velocity": velocity,
            "status": solution.status,
            "policy": self.on_failure,
            "solution": solution,
            "slack": slack,
            "singular": outcome.core_tick.singular,
        }

    def changed(self) -> str | None:
        """Return what was changed since the last tick, in words, or None."""
        return self._core.changed()

    def _replay_step(self, snapshot: Snapshot) -> Tick:
        """Repeat a saved tick, after :meth:`_restore`."""
        return self.step(snapshot)

    def _memory(self) -> tuple[object, ...]:
        """Return the state that ticks change, except warm starts."""
        second = self._second_core
        columns = b"" if second is None else second.memory.preferred_columns
        return self._core.memory.preferred_columns, columns

    def _restore(self, memory: tuple[Any, ...]) -> None:
        """Set the state that :meth:`_memory` returned before a tick."""
        self._core.memory.preferred_columns, columns = memory
        if not columns:
            self._second_core = None
        elif self._margins_in_core:
            self._core_without_margins.memory.preferred_columns = columns

    @property
    def core(self) -> CorePlan:
        """The plan by which the core computes ticks."""
        return self._core

    def conditioning(self, tick: Tick) -> Conditioning:
        """Return how well the tasks determined a tick of this controller: rank and condition."""
        check_kind("conditioning, tick", tick, Tick)
        return conditioning(tick.qp, self.damping, self.joint_weights)

    def _set_parts(
        self,
        tasks: Sequence[Task],
        contacts: Sequence[Task],
        constraints: Sequence[Constraint],
        slack: Mapping[str, float],
    ) -> None:
        """Check all parts, and set all but the contacts."""
        checks.check_parts(self.robot, tasks, contacts, self.limits, constraints, slack)
        had = self.__dict__.get("tasks", ())
        if tasks is not had:  # present tasks may be switched off on purpose
            checks.refuse_weightless(
                [one for one in tasks if not any(one is other for other in had)]
            )
            checks.warn_unused_gains(tasks, self._decides_forces)
        kinds = checks.motion_and_forces(tasks, type(self).__name__, self._decides_forces)
        self._motion, self._force_tasks = kinds
        self.__dict__.update(tasks=tuple(tasks), constraints=tuple(constraints))
        self._slack = dict(slack)

    # ------------------------------------------------------------------ overridden by a level

    def _next_contacts(self, wanted: tuple[Task, ...]) -> tuple[Task, ...]:
        """Return the next tick's contacts: ``wanted``, and those still being released."""
        return wanted

    def _decision(self) -> Decision:
        return Decision.velocity(self.robot, read_only(self.damping * self.joint_weights))

    def _physics_names(self) -> tuple[str, ...]:
        """Return the names of the dynamics' equality rows, which precede the contacts'."""
        return ()

    def _force_rows(self) -> TorqueRows | None:
        """Return the torque level's rows."""
        return None

    def _margins(self, snapshot: Snapshot) -> MarginRows:
        parts = self.constraints, self.slacks, self.dt
        return MarginRows.at(snapshot, *parts, self._decides_forces)

    def _solve_with_margins(
        self, snapshot: Snapshot, margins: MarginRows, start_time: float
    ) -> tuple[Outcome, list[Bounds]]:
        """Return the outcome with margins kept at its end, and the rows of margins in its QP."""

        def held() -> Rows:
            qp = self._assemble(snapshot, start_time).views
            return Rows(qp.A, qp.b, np.ones(qp.b.size))

        solve = self._solve_function(snapshot, start_time)
        over = partial(self._deadline_over, start_time)
        return solve_with_look_ahead(solve, margins, held, over), []

    def _solve_function(self, snapshot: Snapshot, start_time: float) -> Solve:
        """Return a function that solves all levels with given rows of margins."""
        evaluate = self._evaluate_once(snapshot)
        return lambda rows, box: self._solve(
            snapshot, self._core_without_margins, rows, box, start_time, evaluate
        )

    @abstractmethod
    def _command(self, snapshot: Snapshot, core_tick: CoreTick) -> Tick:
        """Return the command of a tick that the core solved."""

    @abstractmethod
    def _answer(self, snapshot: Snapshot, outcome: Outcome, rows: Sequence[Bounds]) -> Tick:
        """Return the command; ``rows`` are the margins' in the outcome's QP."""

    @abstractmethod
    def _fallback(self, snapshot: Snapshot, outcome: Outcome) -> tuple[Array, dict[str, float]]:
        """Return the command of the declared policy, within the limits, and its slack."""

    # ------------------------------------------------------------------ the plan

    def _plan_for(self, contacts: tuple[Task, ...]) -> None:
        """Take up the plan that was made for these contacts, or make one."""
        known = self._known_plans.find(contacts, self._leaving_slack)
        if known is None:
            self._plan(contacts)
        else:
            self.__dict__.update(known)

    def _plan(self, contacts: tuple[Task, ...], curved: frozenset[str] = frozenset()) -> None:
        """Prepare what does not change between ticks, and remember it."""
        self._make_plan(contacts, curved)
        planned = {name: self.__dict__[name] for name in self._planned}
        self._known_plans.keep(contacts, self._leaving_slack, planned)

    def _make_plan(self, contacts: tuple[Task, ...], curved: frozenset[str]) -> None:
        self.__dict__["contacts"] = contacts = mechanics_of(self.robot, contacts)
        self.slacks = Slacks(self._slack, contacts, self.constraints, self._leaving_slack)
        decision, physics, forces = self._decision(), self._physics_names(), self._force_tasks
        self.plan = plan = LevelPlan.of(
            decision, self._motion, contacts, self.slacks, physics, forces
        )
        first, limits = FirstLevel(self.backend, self._decides_forces), self.limits
        self._levels = Levels(
            plan, first, limits, self.dt, self.joint_weights, self._decides_forces
        )
        self_collision = None
        if not self._levels.modifies_qps and core_solves(self.backend):
            self_collision = only_self_collision(self.constraints, self.slacks)
        self._error_offset = np.zeros(len(plan.held.labels))
        self._curved_tasks, self._second_core = curved, None
        if self_collision is not None and self_collision.watched() is None:
            self_collision = None
        self._margins_in_core = self_collision is not None
        self._core = core = self._core_plan(self_collision, curved)
        # Tasks whose error is not their residual's; the core reports the errors of all others.
        own = [one for one in self._motion if any(one is other for other in core.python_tasks)]
        self._deviating = [one for one in own if type(one).deviation is not Task.deviation]
        python = core.python_tasks or core.force_tasks or self._levels.modifies_qps
        margins = self._margins_in_core or not self.constraints
        self._core_suffices = margins and core.solves and not python

    def _core_plan(self, constraint: SelfCollision | None, curved: frozenset[str]) -> CorePlan:
        return CorePlan(
            *(self.robot, self._motion, self._force_tasks, self.plan, self.limits, self.dt),
            *(self.backend, self._force_rows(), constraint, self._levels.modifies_qps),
            constraint is None and bool(self.constraints),  # margins read the state, too
            self.slacks.weights,
            curved,
            self._error_offset,
        )
