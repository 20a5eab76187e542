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
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any, Never

import numpy as np

from wbc.attributes import DeclaredAttributes
from wbc.constraints.collision import SelfCollision
from wbc.constraints.limits import Box, Limits
from wbc.constraints.mechanics import mechanics_of
from wbc.constraints.rows import Bounds, Constraint
from wbc.controllers import checks
from wbc.controllers.blocks import Asked
from wbc.controllers.conditioning import Conditioning, conditioning
from wbc.controllers.contact_forces import NO_RAMPS
from wbc.controllers.core_plan import CorePlan, solves
from wbc.controllers.core_tick import CoreTick
from wbc.controllers.first_level import FirstLevel
from wbc.controllers.force_rows import TorqueRows
from wbc.controllers.joint_weights import JointWeights, weights_of
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

# How contacts are treated: as equality rows, which the core eliminates; both are the same now.
FORMULATIONS = ("equality", "reduced")
SETTLED = 128  # ticks in which a robot may come to rest
Answers = Callable[[CorePlan], list[Asked]]


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
        A backend, or its name: ``"proxqp"`` or any that qpsolvers finds installed. Controllers that
        share a backend share its warm starts, one for each set of contacts.
    formulation:
        ``"equality"`` or ``"reduced"``: both are the same now, the core eliminates contacts to a
        smaller QP with the same optimum (paper eqs. 34-37).
    damping:
        Weight of 1/2 |v|^2 in the cost, [1/(rad/s)^2]: picks one among equally good velocities.
    joint_weights:
        Factors on the damping, 1/2 damping * sum of weight * v^2: a joint of weight 10 moves a
        tenth as much as one of weight 1 that serves as well. By name or pattern (``{"*wrist*": 10,
        "base": 100}``, later entries win, all others 1), or (nv,). They only decide what tasks
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
    formulation: str
    on_failure: str
    plan: LevelPlan
    slacks: Slacks
    tasks: tuple[Task, ...]
    contacts: tuple[Task, ...]
    constraints: tuple[Constraint, ...]
    deadline: float | None
    ticks: int  # that were answered
    _core: CorePlan
    _second: CorePlan | None  # without margins, where the first has them; if it was asked for
    _curved: frozenset[str]
    _added: Array  # (held,) to the errors of loops and gears

    _fixed = checks.PLANNED
    _policies: tuple[str, ...] = POLICIES
    _said = False  # that tasks compete
    _bears = False  # whether the level decides forces
    _going_slack: Mapping[str, float] = NO_SLACK  # of contacts that are leaving
    _ramped: Mapping[str, float] = NO_RAMPS  # largest normal forces of those that come or go

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
        formulation: str = "equality",
        damping: float = 1e-6,
        joint_weights: JointWeights | None = None,
        on_failure: str = "hold",
        deadline: float | None = None,
    ) -> None:
        checks.refuse_unnamed(more)
        contacts, slack = checks.held_by(robot, contacts), NO_SLACK if slack is None else slack
        self.robot, self.limits, self.ticks = robot, limits, 0
        self._take(tasks, contacts, constraints, slack)
        self.dt = time_step("controller", dt)
        self.damping = finite_number("controller, damping", damping, above=0.0)
        self.joint_weights = weights_of(robot, joint_weights)
        self.backend = backend_of(solver)
        self.formulation = one_of("formulation", formulation, FORMULATIONS)
        self.on_failure, self.deadline = on_failure, deadline
        self._rest = bytes(8 * robot.nv)  # a velocity of 0
        self._missing_velocity = MissingVelocity(self.dt, damped=self._bears)
        self._plan(tuple(contacts))

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
        checks.check_list("contacts", contacts, Task)  # None would leave them as they are
        self.change(contacts=contacts)

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
        own, before = self.__dict__, self._kept()
        own["ticks"] = number = own["ticks"] + 1
        measured, limits = snapshot.measured, self.limits
        fast = None if limits is None else limits.acceleration
        began = limits, measured, fast, self.dt, self, before, number  # see Began
        try:
            tick = self._step(snapshot)
        except ControllerFailure as failure:
            if isinstance(failure.tick, Tick):
                failure.tick.__dict__["_began"] = began
            raise
        except (AttributeError, IndexError, InvalidInputError, TypeError, ValueError):
            checks.look_closely(snapshot, self.dt, self._motion, self.contacts, self.constraints)
            raise
        tick.__dict__["_began"] = began
        if not number & (number - 1):  # the first tick, the second, fourth, eighth...
            self._look_at(snapshot, tick, number)
        if measured.endswith(self._rest):
            self._missing_velocity.watch(snapshot, tick.velocity, limits)
        return tick

    def _look_at(self, snapshot: Snapshot, tick: Tick, number: int) -> None:
        """Log what a user should know of a tick, rarely: it takes as long as one."""
        if number == 1:
            checks.say_outside(snapshot)
            checks.say_displaced(snapshot, self.contacts)
        elif number >= SETTLED and tick.ok and not (self._bears or self._said):
            given = self._motion, snapshot, tick.velocity, self.dt
            self._said = checks.say_competing(*given)

    def _step(self, snapshot: Snapshot) -> Tick:
        """Return the command: the core's alone, as most are, or by what is decided here."""
        begun, plan, found = perf_counter(), self._core, None
        if not plan.serves(self.limits, self.dt):
            self._plan(self.contacts)
        elif self._plain:
            found = plan.tick(snapshot, (), None, self._ramped, begun)
            if found is not None and found.solved:
                return self._command(snapshot, found)
        return self._decided(snapshot, begun, found)

    def _decided(self, snapshot: Snapshot, begun: float, found: CoreTick | None = None) -> Tick:
        """Return the command of a tick that the core alone does not answer, from top to bottom.

        ``found`` is what it made of it, without an answer; None: nothing yet.
        """
        if self._margins_in_core or not self.constraints:
            given = self._asked_once(snapshot)
            outcome = self._solve(snapshot, self._core, None, None, begun, given, found)
            # Planned anew meanwhile, the core may no longer keep the margin.
            if not self.constraints or (outcome.solved and self._margins_in_core):
                return self._answer(snapshot, outcome, [])
        # Constraints in Python; or the core's margin has no answer, or one that leads inside.
        margins = self._margins(snapshot)
        outcome, rows = self._solve_kept_apart(snapshot, margins, begun)
        return self._answer(snapshot, outcome, rows)

    def _solve(
        self,
        snapshot: Snapshot,
        plan: CorePlan,
        bounds: Bounds | None,
        box: Box | None,
        begun: float,
        given: Answers,
        found: CoreTick | None = None,
        opened: bool = False,
    ) -> Outcome:
        """Return what comes of all levels, with inequality rows of constraints in Python.

        ``box``: on v+, of an earlier round of this tick; None in the first. ``opened``: whether it
        was opened in this round, as far as rows needed it. ``given``: what
        tasks in Python answer, which is the same in all rounds.
        """
        levels = self._levels
        if not levels.braked:
            box = None  # that of the limits, in each round
        simple = box is None and not levels.looked_into
        if found is None:
            found = plan.tick(snapshot, given(plan), bounds, self._ramped, begun, simple)
            if found is None:
                plan = self._planned_anew(plan, given(plan))
                return self._solve(snapshot, plan, bounds, box, begun, given)
        if found.solved:
            return Outcome(found)
        hurried = self._is_over(begun)
        outcome = levels.solve(plan, found, snapshot, box, simple, hurried)
        if not outcome.solved and not opened and levels.braked:
            wider = levels.relaxed_box(found, snapshot)
            if wider is not None:
                return self._solve(snapshot, plan, bounds, wider, begun, given, opened=True)
        return outcome

    @property
    def _marginless(self) -> CorePlan:
        """The plan in which no margin is the core's: theirs are rows that come from here."""
        if not self._margins_in_core:
            return self._core
        if self._second is None:  # few ticks ask for it, and each change of contacts plans anew
            self._second = self._core_plan(None, self._curved)
        return self._second

    def _planned_anew(self, plan: CorePlan, given: Sequence[Asked]) -> CorePlan:
        """Plan again where tasks are others than those planned; return what stands for ``plan``."""
        second = plan is self._second
        residuals = {one.task.name: one.residual for one in given if one.residual is not None}
        curved = (name for name, one in residuals.items() if one.curvature is not None)
        self._plan(self.contacts, frozenset(curved))
        return self._marginless if second else self._core

    def _set_up(self, snapshot: Snapshot, begun: float) -> CoreTick:
        """Return a tick whose first QP is set up, without margins, and not solved."""
        plan = self._marginless
        given = self._ask(plan, snapshot)
        found = plan.tick(snapshot, given, None, self._ramped, begun, solve=False)
        if found is None:
            self._planned_anew(plan, given)
            return self._set_up(snapshot, begun)
        return found

    def _is_over(self, begun: float) -> bool:
        """Whether the deadline of a tick that began then is over."""
        return self.deadline is not None and perf_counter() - begun > self.deadline

    def _asked_once(self, snapshot: Snapshot) -> Answers:
        """Return what asks a plan's tasks in Python, once in a tick."""
        known: dict[CorePlan, list[Asked]] = {}

        def answers(plan: CorePlan) -> list[Asked]:
            if plan not in known:
                known[plan] = self._ask(plan, snapshot)
            return known[plan]

        return answers

    def _ask(self, plan: CorePlan, snapshot: Snapshot) -> list[Asked]:
        """Return the answers of tasks and contacts that the core does not know."""
        asked = []
        for task in plan.python_tasks:
            residual = residual_of(task, snapshot)
            drift = drift_of(task, snapshot) if self._bears else None
            asked.append(Asked(task, residual, drift))
        return asked

    def _known(self, outcome: Outcome, snapshot: Snapshot) -> dict[str, Any]:
        """Return what a tick does not read from the core."""
        known: dict[str, Any] = {}
        if outcome.step_scale < 1.0:
            known["step_scale"] = outcome.step_scale
        return known | self._errors(outcome.found, snapshot)

    def _errors(self, found: CoreTick, snapshot: Snapshot) -> dict[str, Any]:
        """Return the errors of tasks, of targets of now, where they are not the residuals'."""
        if not self._deviating:
            return {}
        errors = dict(found.errors)
        for task in self._deviating:
            errors[task.name] = deviation_of(task, snapshot, found.residual(task.name))
        return {"errors": errors}

    def _failed(self, outcome: Outcome, snapshot: Snapshot) -> dict[str, Any]:
        """Return what a tick without a solution is made of, by the declared policy."""
        velocity, slack = self._fallback(snapshot, outcome)
        velocity.setflags(write=False)
        known = self._known(outcome, snapshot) | {"errors": outcome.found.errors}
        solution = outcome.solution
        return known | {
            "velocity": velocity,
            "status": solution.status,
            "policy": self.on_failure,
            "solution": solution,
            "slack": slack,
            "singular": outcome.found.singular,
        }

    def changed(self) -> str | None:
        """Return what was changed since the last tick, in words, or None."""
        return self._core.changed()

    def _again(self, snapshot: Snapshot) -> Tick:
        """Answer a saved tick's state again, once :meth:`_return_to` has been called."""
        return self.step(snapshot)

    def _kept(self) -> tuple[object, ...]:
        """Return what is kept from tick to tick, but for warm starts: what a tick changes."""
        second = self._second
        return self._core.memory.last_pivots, b"" if second is None else second.memory.last_pivots

    def _return_to(self, kept: tuple[Any, ...]) -> None:
        """Take up what was kept before a tick."""
        self._core.memory.last_pivots, last_pivots = kept
        if not last_pivots:
            self._second = None
        elif self._margins_in_core:
            self._marginless.memory.last_pivots = last_pivots

    @property
    def core(self) -> CorePlan:
        """What the core computes ticks by."""
        return self._core

    def conditioning(self, tick: Tick) -> Conditioning:
        """Return how well the tasks determined a tick of this controller: rank and condition."""
        check_kind("conditioning, tick", tick, Tick)
        return conditioning(tick.qp, self.damping, self.joint_weights)

    def _take(
        self,
        tasks: Sequence[Task],
        contacts: Sequence[Task],
        constraints: Sequence[Constraint],
        slack: Mapping[str, float],
    ) -> None:
        """Check all parts, and take over all but the contacts."""
        checks.check_parts(self.robot, tasks, contacts, self.limits, constraints, slack)
        had = self.__dict__.get("tasks", ())
        if tasks is not had:  # tasks that it has may be off on purpose
            checks.refuse_idle([one for one in tasks if not any(one is other for other in had)])
            checks.say_unused_gains(tasks, self._bears)
        kinds = checks.motion_and_forces(tasks, type(self).__name__, self._bears)
        self._motion, self._force_tasks = kinds
        self.__dict__.update(tasks=tuple(tasks), constraints=tuple(constraints))
        self._slack = dict(slack)

    # ------------------------------------------------------------------ what a level says

    def _next_contacts(self, wanted: tuple[Task, ...]) -> tuple[Task, ...]:
        """Return what is held in the next tick if ``wanted`` shall be held from then on."""
        return wanted

    def _decision(self) -> Decision:
        return Decision.velocity(self.robot, read_only(self.damping * self.joint_weights))

    def _physics_names(self) -> tuple[str, ...]:
        """Return the names of the equality rows that physics puts before the contacts'."""
        return ()

    def _force_rows(self) -> TorqueRows | None:
        """Return what the torque level adds."""
        return None

    def _margins(self, snapshot: Snapshot) -> MarginRows:
        given = self.constraints, self.slacks, self.dt
        return MarginRows.at(snapshot, *given, self._bears)

    def _solve_kept_apart(
        self, snapshot: Snapshot, margins: MarginRows, begun: float
    ) -> tuple[Outcome, list[Bounds]]:
        """Return the outcome with margins kept where it leads, and the rows that it took."""

        def held() -> list[Rows]:
            qp = self._set_up(snapshot, begun).views
            return [Rows(qp.A, qp.b, np.ones(qp.b.size))]

        over = partial(self._is_over, begun)
        return solve_with_look_ahead(self._solving(snapshot, begun), margins, held, over), []

    def _solving(self, snapshot: Snapshot, begun: float) -> Solve:
        """Return what solves all levels with rows of margins; tasks in Python are asked once."""
        given = self._asked_once(snapshot)
        return lambda rows, box: self._solve(snapshot, self._marginless, rows, box, begun, given)

    @abstractmethod
    def _command(self, snapshot: Snapshot, found: CoreTick) -> Tick:
        """Return the command of a tick that the core solved."""

    @abstractmethod
    def _answer(self, snapshot: Snapshot, outcome: Outcome, rows: Sequence[Bounds]) -> Tick:
        """Return the command; ``rows`` of margins are those that the outcome took."""

    @abstractmethod
    def _fallback(self, snapshot: Snapshot, outcome: Outcome) -> tuple[Array, dict[str, float]]:
        """Return the command of the declared policy, within the limits, and the slack it needs."""

    # ------------------------------------------------------------------ the plan

    def _plan(self, contacts: tuple[Task, ...], curved: frozenset[str] = frozenset()) -> None:
        """Work out what does not change between ticks."""
        self.__dict__["contacts"] = contacts = mechanics_of(self.robot, contacts)
        self.slacks = Slacks(self._slack, contacts, self.constraints, self._going_slack)
        decision, physics, forces = self._decision(), self._physics_names(), self._force_tasks
        self.plan = plan = LevelPlan.of(
            decision, self._motion, contacts, self.slacks, physics, forces
        )
        first, limits = FirstLevel(self.backend, self._bears), self.limits
        self._levels = Levels(plan, first, limits, self.dt, self.joint_weights, self._bears)
        kept_apart = None
        if not self._levels.looked_into and solves(self.backend):
            kept_apart = only_self_collision(self.constraints, self.slacks)
        self._added = np.zeros(len(plan.held.labels))
        self._curved, self._second = curved, None
        if kept_apart is not None and kept_apart.watched() is None:
            kept_apart = None
        self._margins_in_core = kept_apart is not None
        self._core = core = self._core_plan(kept_apart, curved)
        # Asked in the ticks; of all others the core reports the error.
        asked = [one for one in self._motion if any(one is other for other in core.python_tasks)]
        self._deviating = [one for one in asked if type(one).deviation is not Task.deviation]
        python = core.python_tasks or core.force_tasks or self._levels.looked_into
        kept = self._margins_in_core or not self.constraints
        self._plain = kept and core.solves and not python

    def _core_plan(self, constraint: SelfCollision | None, curved: frozenset[str]) -> CorePlan:
        return CorePlan(
            *(self.robot, self._motion, self._force_tasks, self.plan, self.limits, self.dt),
            *(self.backend, self._force_rows(), constraint, self._levels.looked_into),
            constraint is None and bool(self.constraints),  # margins look at the state, too
            self.slacks.weights,
            curved,
            self._added,
        )
