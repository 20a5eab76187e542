"""The torque level: the same tasks as inverse dynamics, by one QP per tick.

The unknowns are the velocity at the end of the tick and the contact forces, x = (v+, f). Torques
are an affine expression of x (:mod:`wbc.controllers.dynamics`): its base rows are equalities, its
joint rows give the torque bounds, the torque costs and the command. Tasks follow their second-order
laws, contacts stand still to second order; limits and margins are those of the velocity level,
statements about v+.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from typing import Any, Never, cast

import numpy as np
from numpy.typing import ArrayLike

from wbc.constraints.limits import Limits
from wbc.constraints.rows import LEGS, Bounds, Constraint, reachable_rows
from wbc.controllers.blocks import TaskEvaluation
from wbc.controllers.checks import FIXED, MAKE_ANOTHER, check_snapshot
from wbc.controllers.closed_loop import ticks_of
from wbc.controllers.contact_forces import ContactForces, Reaction
from wbc.controllers.controller import Controller
from wbc.controllers.core_plan import CorePlan
from wbc.controllers.core_tick import CoreTick
from wbc.controllers.dry_friction import DryFriction
from wbc.controllers.dynamics import TickDynamics
from wbc.controllers.effort_bounds import StanceBraking, effort_bounds, limits_within
from wbc.controllers.force_ramps import ForceRamps
from wbc.controllers.force_rows import TorqueRows
from wbc.controllers.joint_weights import JointWeights
from wbc.controllers.look_ahead import MarginRows, solve_with_cuts
from wbc.controllers.outcome import Outcome
from wbc.controllers.plan import Decision
from wbc.controllers.prediction import StatePrediction
from wbc.controllers.relaxation import Physical, relaxed_amounts, relaxed_qp
from wbc.controllers.tick import RELAX, Tick
from wbc.controllers.torque_tick import TorqueTick
from wbc.errors import ControllerFailure, InvalidInputError
from wbc.qp.backend import Backend, torque_level_doubt
from wbc.robot import Robot, Snapshot
from wbc.robot.limits import BASE_NV
from wbc.robot.model import check_robot
from wbc.robot.notes import doubt_delay
from wbc.tasks.task import Task
from wbc.validate import Array, by_name, finite_array, finite_number, read_only

BASE_FORCES = tuple(f"dynamics {row}" for row in ("fx", "fy", "fz", "mx", "my", "mz"))
POLICIES = ("damp", "raise")
# Factor on the damping of forces of gears, closed loops and a bolted base: the motion determines
# them, and the damping only chooses among them where loops are overconstrained.
INTERNAL = 1e-4

# Default time [s] over which contact forces ramp up and down.
RAMP = 0.05
# Default time constant [s] of springs. Bipeds on springs of 6 kN m/rad stand with 0.01 to 1, with
# 0.01 only if they begin loaded; a table on springs of 0.3 to 6 kN m/rad, with rotors of
# 0.05 kg m^2, with 0.005 to 0.015.
SPRING_TIME = 0.015
# Time constant [s] with which joints come to rest by the policy "damp", within the torque bounds.
REST_TIME = 0.05


class TorqueController(Controller):
    """Inverse dynamics by one QP per tick; commands torques.

    Tasks are driven by their :class:`~wbc.laws.AccelerationLaw` (``kp``, ``kd``).

    **Always an answer.** Dynamics, friction cones and torque bounds are hard. Contacts, limits and
    margins are hard while a tick can keep them; otherwise they give way in one more QP
    (:mod:`wbc.controllers.relaxation`), by name: ``tick.policy`` is ``"relax"``. If even that
    fails, joints are brought to rest within the torque bounds (``"damp"``).

    Parameters
    ----------
    contacts:
        What stands on the ground, with its friction: :func:`wbc.support`.
    dt:
        Period of the control loop [s].
    torque_limits:
        Factor on the robot's effort limits, or None for no torque bounds.
    damping:
        Weight of 1/2 |v+ - v|^2 in the cost.
    force_damping:
        Weight of 1/2 |f dt/m|^2, the contact forces as the velocity [m/s] that each alone would
        give to the robot's mass in a tick: shares the load among corners. No robot is too light for
        the default: CoM and CoP of a lean (7 to 90 kg) are those of a hundredth of it to 0.01 mm.
    force_ramp:
        How long forces take to come and go when contacts change [s]; 0: at once.
    on_failure:
        ``"damp"`` or ``"raise"`` (:class:`~wbc.errors.ControllerFailure`), if even the relaxed QP
        has no solution.
    delay:
        How old states are when the torque that answers to them acts [s], where that is known: the
        age of what is measured, and how late torques arrive. Each tick answers to the state that
        :meth:`predicted` has for then.
    spring_time:
        While anything bears on the ground: within which springs of joints that have no motor give
        way until they bear what is asked for [s]: they force -k (x + spring_time^2 a). By -k x
        alone (0), which is what acts at once, ground that is felt through stiff springs is pressed
        by accelerating the little that is behind them, and torques chatter. Slower springs feel
        nothing of it.
    friction_compensation:
        Part of the joints' dry friction (``robot.friction``) that torques make up for, in [0, 1],
        where they are going: added to what the QP finds, within the torque bounds. By default none:
        rows know of no dry friction, and servos that have much of it lag behind.

    See :class:`~wbc.controllers.controller.Controller` for the others.

    Raises
    ------
    InvalidInputError
        A contact of which it is not known where its forces act, or a joint that follows another
        one and has an effort limit of its own to keep.
    """

    force_damping: float
    force_ramp: float
    delay: float
    spring_time: float
    friction_compensation: float
    torque_bounds: Array  # of the joints (nv - 6,) [N m]
    contact_forces: ContactForces

    _fixed = FIXED | dict.fromkeys(
        ("torque_bounds", "force_damping", "delay", "spring_time"), MAKE_ANOTHER
    )
    _planned = (*Controller._planned, "contact_forces", "_rows")
    _policies = POLICIES
    _decides_forces = True

    def __init__(
        self,
        robot: Robot,
        tasks: Sequence[Task],
        *more: Never,
        contacts: Sequence[Task] | None = None,
        limits: Limits | None = None,
        constraints: Sequence[Constraint] = (),
        slack: Mapping[str, float] | None = None,
        dt: float = 0.002,
        solver: str | Backend = "proxqp",
        torque_limits: float | None = 1.0,
        damping: float = 1e-3,
        force_damping: float = 1e-2,
        force_ramp: float = RAMP,
        joint_weights: JointWeights | None = None,
        on_failure: str = "damp",
        deadline: float | None = None,
        delay: float = 0.0,
        spring_time: float = SPRING_TIME,
        friction_compensation: float = 0.0,
    ) -> None:
        check_robot(type(self).__name__, robot)
        self.force_damping = finite_number("controller, force_damping", force_damping, above=0.0)
        self.force_ramp = force_ramp
        self.spring_time = finite_number("controller, spring_time", spring_time, least=0.0)
        self.friction_compensation = friction_compensation
        self.torque_bounds = effort_bounds(robot, torque_limits)
        self._braking = StanceBraking(robot, self.torque_bounds)
        self._last: Reaction | None = None
        self._ramps = ForceRamps(robot.weight)
        self._wrenches: Mapping[str, Array] = {}
        self._known_forces = np.zeros(robot.nv)
        self._last_torque: Array | None = None
        super().__init__(
            robot,
            tasks,
            *more,
            contacts=contacts,
            limits=limits_within(limits, self.torque_bounds),
            constraints=constraints,
            slack=slack,
            dt=dt,
            solver=solver,
            damping=damping,
            joint_weights=joint_weights,
            on_failure=on_failure,
            deadline=deadline,
        )
        self.delay = finite_number("controller, delay", delay, least=0.0)
        predicted = f"controller: a delay of {self.delay:g} s is predicted over as if nothing"
        doubt_delay(f"{predicted} disturbed meanwhile", self.delay)
        self._prediction = StatePrediction(robot, self.delay, self.dt) if self.delay else None
        doubt = torque_level_doubt(self.backend)
        if doubt is not None:
            logging.getLogger(__name__).warning(
                "controller: %s; what it leaves, the core's 'active_set' answers", doubt
            )

    @property
    def last_torque(self) -> Array | None:
        """(nv - 6,) command of the last tick [N m or N]; None before the first."""
        return self._last_torque

    @cached_property
    def _friction(self) -> DryFriction:
        return DryFriction(self.robot)

    def _set_attribute(self, name: str, value: Any) -> None:
        if name == "force_ramp":
            value = finite_number("controller, force_ramp", value, least=0.0)
        elif name == "friction_compensation":
            value = finite_number(f"controller, {name}", value, least=0.0)
            if value > 1.0:
                raise InvalidInputError(f"controller, {name}: {value:g} is above 1, all of it")
        super()._set_attribute(name, value)

    def step(
        self, snapshot: Snapshot, wrenches: Mapping[str, ArrayLike] | None = None
    ) -> TorqueTick:
        """Return the command for ``snapshot``, torques in it; see :meth:`Controller.step`.

        Parameters
        ----------
        wrenches:
            What acts on the robot from outside in this tick and is known, besides gravity and what
            contacts bear: by frame a wrench (6,) on the robot at the frame's origin, world axes,
            [N] then [N m]. Torques and contact forces bear it, so that nothing sags.

        Raises
        ------
        UnknownNameError
            A wrench at no frame of the robot.
        InvalidInputError
            A wrench that is not six finite numbers; or see :meth:`Controller.step`.
        """
        known = self.predicted(snapshot)
        if wrenches is not None or self._wrenches:
            self._set_known_wrenches(known, {} if wrenches is None else wrenches)
        tick = cast(TorqueTick, super().step(known))
        if self._prediction is not None:
            self._prediction.record(tick.acceleration)
        return tick

    def _replay_step(self, snapshot: Snapshot) -> Tick:
        """Repeat a tick at its predicted state, with its known wrenches."""
        self._set_known_wrenches(snapshot, self._wrenches)
        return super().step(snapshot)

    def _set_known_wrenches(self, snapshot: Snapshot, wrenches: Mapping[str, ArrayLike]) -> None:
        """Store the known external wrenches and their generalised forces."""
        check_snapshot(self.robot, snapshot)
        given = {
            frame: read_only(finite_array(f"step, wrenches[{frame!r}]", wrench, (6,)))
            for frame, wrench in by_name("step, wrenches", wrenches).items()
        }
        if not (given or self._wrenches):  # as in the tick before
            return
        forces = np.zeros(self.robot.nv)
        for frame, wrench in given.items():
            forces += snapshot.jacobian(frame).T @ wrench
        self._known_forces[:] = forces
        self.__dict__["_wrenches"] = given

    def predicted(self, snapshot: Snapshot) -> Snapshot:
        """Return the state that is predicted for ``delay`` after ``snapshot``.

        Raises
        ------
        InvalidInputError
            Not a snapshot, or one of another robot.
        """
        if self._prediction is None:
            return snapshot
        check_snapshot(self.robot, snapshot)
        return self._prediction.predict(snapshot)

    def reset(self) -> None:
        """Forget the ticks before, where the robot is put elsewhere: after ``plant.reset(q)``.

        Their torques led to another state: over a ``delay`` the first ticks would predict by them.
        Contacts bear at once, and those being released are dropped. Targets, gains, contacts and
        ``ticks`` stay.
        """
        if self._prediction is not None:
            self._prediction.reset()
        _, released = self._ramps.running
        self._ramps, self._last, self._last_torque = ForceRamps(self.robot.weight), None, None
        if released:
            self._leaving_slack = {}
            self._plan_for(tuple(one for one in self.contacts if one.name not in released))

    def set_contacts(self, contacts: Sequence[Task], ramp: float | None = None) -> None:
        """Change what is held; forces come and go over ``ramp`` seconds, so that no torque jumps.

        The largest normal force of a contact that is new grows from 0; that of one that is left
        out shrinks from what it bears, and only then it is dropped: until then it is held, with the
        slack that it had, and ``tick.ramps`` says so. Contacts with friction that were not there in
        the last tick are new; grips and other free forces come and go at once, and so does all
        before the first tick. Ticks that raise count, too: their time passes. Solvers keep
        their warm starts for each set of contacts.

        Parameters
        ----------
        ramp:
            [s]; 0 to change at once; None: ``force_ramp``.

        Raises
        ------
        InvalidInputError
            As when the controller is made, or not a duration.
        UnknownNameError
            A contact with slack is left out: :meth:`change` takes contacts and slack together.
        """
        self._check_contacts(contacts)
        with self._unchanged_if_refused():
            self._plan_for(self._next_contacts(tuple(contacts), ramp))

    def _step(self, snapshot: Snapshot) -> Tick:
        """Drop the contacts whose forces have ramped to zero, then step as every controller."""
        released = self._ramps.advance()
        if released:
            remaining = tuple(one for one in self.contacts if one.name not in released)
            self._remember_slack([one for one in remaining if one.name in self._leaving_slack])
            self._plan_for(remaining)
        self.__dict__["_ramp_limits"] = self._ramps.most
        return super()._step(snapshot)

    def _memory(self) -> tuple[object, ...]:
        own = self._last, self._ramps.running, self.contacts, dict(self._leaving_slack)
        return *super()._memory(), *own, self._wrenches

    def _restore(self, memory: tuple[Any, ...]) -> None:
        *base, self._last, running, contacts, leaving_slack, self._wrenches = memory
        self._ramps.running = running
        if contacts != self.contacts:
            self._leaving_slack = leaving_slack
            self._plan_for(contacts)
        super()._restore(tuple(base))

    # ------------------------------------------------------------------ the level

    def _next_contacts(
        self, wanted: tuple[Task, ...], ramp: float | None = None
    ) -> tuple[Task, ...]:
        ramp = self.force_ramp if ramp is None else finite_number("contacts, ramp", ramp, least=0.0)
        last, held = self._last, wanted if self._last is None else self.contacts
        left_out = {one.name for one in held} - {one.name for one in wanted}
        loads = last.normal_forces() if last is not None and left_out else {}
        ramps = ForceRamps(self.robot.weight)  # a change that is refused has those that there were
        ramps.running, self._ramps = self._ramps.running, ramps
        changed = ramps.change(held, wanted, loads, ticks_of(ramp, self.dt))
        self._remember_slack(changed[len(wanted) :])
        return changed

    def _remember_slack(self, leaving: Sequence[Task]) -> None:
        """Keep the slack weights of contacts that are being released."""
        names, weights = [one.name for one in leaving], self.slacks.weights
        self._leaving_slack = {name: weights[name] for name in names if name in weights}

    def _decision(self) -> Decision:
        robot = self.robot
        unit = robot.mass / self.dt  # N per unit of a force unknown
        self.contact_forces = forces = ContactForces(robot, self.contacts, unit)
        followers = [robot.joint_index(name) for name in robot.motorless]
        bounded = np.isfinite(self.torque_bounds)
        bounded[[k - 6 for k in followers]] = False
        places, most = 6 + np.flatnonzero(bounded), self.torque_bounds[bounded] / unit
        labels = tuple(f"{robot.joint_names[k - 6]} torque" for k in places)
        # Base, and joints without a motor of their own: no torque there.
        passive = np.array([*range(6), *followers])
        slow = self._braking.decelerations(self.limits, self.contacts)
        known = slow, self.spring_time, self._known_forces
        self._rows = TorqueRows(forces, passive, places, most, labels, *known)
        velocity = Decision.velocity(robot, read_only(self.damping * self.joint_weights))
        damping = np.full(forces.size, self.force_damping)
        damping[forces.internal] *= INTERNAL
        return velocity.extended(forces.names, damping)

    def _physics_names(self) -> tuple[str, ...]:
        followers = tuple(f"dynamics {name}" for name in self.robot.motorless)
        return BASE_FORCES + followers

    def _force_rows(self) -> TorqueRows:
        return self._rows

    def _evaluate_python_tasks(self, plan: CorePlan, snapshot: Snapshot) -> list[TaskEvaluation]:
        motion = super()._evaluate_python_tasks(plan, snapshot)
        if not plan.force_tasks:
            return motion

        def physics() -> tuple[Array, Array]:
            # The core computes torques as an affine function of the unknowns.
            core_tick = plan.tick(snapshot, motion, None, self._ramp_limits, solve=False)
            if core_tick is None:  # the controller will replan, and evaluate again
                nv = snapshot.v.size
                return np.zeros((nv, nv + self.contact_forces.size)), np.zeros(nv)
            return core_tick.views.D, core_tick.views.offset

        dynamics = self._dynamics(physics, snapshot)
        forces = ((one, one.force_rows(dynamics)) for one in plan.force_tasks)
        return motion + [TaskEvaluation(one, rows=rows) for one, rows in forces]

    def _dynamics(
        self, physics: Callable[[], tuple[Array, Array]], snapshot: Snapshot
    ) -> TickDynamics:
        return TickDynamics(snapshot, self.contact_forces, physics, self._last)

    # ------------------------------------------------------------------ parts of the tick

    def _solve_with_margins(
        self, snapshot: Snapshot, margins: MarginRows, start_time: float
    ) -> tuple[Outcome, list[Bounds]]:
        legs = 0.0 if self.robot.fixed_base else LEGS
        parts = [reachable_rows(part, snapshot.v, self.dt, legs) for part in margins.parts]
        margins = margins._replace(parts=parts)
        # Scaling a step down does not make it safer at this level.
        solve = self._solve_function(snapshot, start_time)
        over = partial(self._deadline_over, start_time)
        outcome, rows, _ = solve_with_cuts(solve, margins, over)
        return outcome, rows

    def _command(self, snapshot: Snapshot, core_tick: CoreTick) -> Tick:
        known = self._errors(core_tick, snapshot)
        return self._make_tick(
            snapshot, core_tick, known, core_tick.velocity, core_tick.torque, core_tick.forces
        )

    def _answer(self, snapshot: Snapshot, outcome: Outcome, rows: Sequence[Bounds]) -> Tick:
        core_tick = outcome.core_tick
        if outcome.solved:
            return self._command(snapshot, core_tick)
        known = self._solve_relaxed(snapshot, outcome, rows)
        velocity, torque, f = core_tick.velocity, core_tick.torque, core_tick.forces
        if known["policy"] != RELAX:  # joints come to rest, contact forces unknown
            velocity, f = known.pop("velocity"), np.zeros(self.contact_forces.size)
            x = np.concatenate((velocity, f))
            a = core_tick.views
            torque = self._dynamics(lambda: (a.D, a.offset), snapshot).torques(x)
        tick = self._make_tick(snapshot, core_tick, known, velocity, torque, f)
        if tick.policy == "raise":
            raise ControllerFailure(tick.report(), tick)
        return tick

    def _make_tick(
        self,
        snapshot: Snapshot,
        core_tick: CoreTick,
        known: dict[str, Any],
        velocity: Array,
        torque: Array,
        f: Array,
    ) -> TorqueTick:
        """Return the tick, its torques clipped to their bounds."""
        bounds, acceleration = self.torque_bounds, (velocity - snapshot.v) / self.dt
        if self.friction_compensation:
            missing = self._friction.torques(snapshot.v[BASE_NV:], acceleration[BASE_NV:])
            torque += self.friction_compensation * missing
        np.minimum(np.maximum(torque, -bounds, out=torque), bounds, out=torque)
        self.__dict__["_last"] = last = Reaction(self.contact_forces, snapshot, f)
        known["torque"] = self.__dict__["_last_torque"] = read_only(torque)
        known["acceleration"] = read_only(acceleration)
        known["reaction"], known["ramps"] = last, self._ramp_limits
        known["wrenches"] = self._wrenches
        return TorqueTick.reading(core_tick, velocity, known)

    def _solve_relaxed(
        self, snapshot: Snapshot, failed: Outcome, margins: Sequence[Bounds]
    ) -> dict[str, Any]:
        """Solve the relaxed QP; return the fields of its tick."""
        core_tick = self._assemble(snapshot, failed.core_tick.start_time)
        plan, qp = self._core_without_margins, core_tick.qp_of(0)
        if len(self.plan.levels) > 1:
            P, g = plan.memory.cost(-1)
            qp = qp._replace(P=P, g=g)
        rows, surfaces = self._rows, len(self.contact_forces.surfaces)
        ranges = slice(rows.bounded.size, rows.bounded.size + surfaces)
        physical = Physical(rows.passive.size, qp.u.size, ranges)
        relaxed = relaxed_qp(self.plan, qp, physical, margins, plan.heaviest)
        rest = np.concatenate((snapshot.v, np.zeros(self.contact_forces.size)))
        first = self._levels.first
        solution = first.solve_relaxed(relaxed.slackless, relaxed.weights, rest)
        core_tick.relaxed = relaxed
        known: dict[str, Any] = {"solution": solution, "status": solution.status}
        known |= {"refuted": failed.solution}
        known |= {"singular": {}, "left_out": failed.core_tick.skipped}
        failed.core_tick.replace_by(core_tick)
        if not solution.solved:
            known |= self._fallback_fields(failed._replace(failed=solution), snapshot)
            return known
        core_tick.views.x[:] = solution.x[: core_tick.views.x.size]
        core_tick.views.found[4] = 1.0
        plan.memory.finish()
        violated = relaxed_amounts(self.plan, qp, physical, relaxed, solution.x)
        known |= {"errors": core_tick.errors} | self._errors(core_tick, snapshot)
        return known | {"policy": RELAX, "slack": violated}

    def _fallback(self, snapshot: Snapshot, outcome: Outcome) -> tuple[Array, dict[str, float]]:
        """Return the velocity of a robot whose joints come to rest."""
        velocity = snapshot.v.copy()
        velocity[6:] *= max(0.0, 1.0 - self.dt / REST_TIME)
        return velocity, {}
