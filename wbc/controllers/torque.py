"""The torque level: the same tasks as inverse dynamics, by one QP per tick.

The unknowns are the velocity at the end of the tick and the contact forces, x = (v+, f). Torques
are an affine expression of x (:mod:`wbc.controllers.dynamics`): its base rows are equalities, its
joint rows give the torque bounds, the torque costs and the command. Tasks follow their second-order
laws, contacts stand still to second order; limits and margins are those of the velocity level,
statements about v+.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from wbc.constraints.limits import Limits
from wbc.constraints.rows import Bounds, Constraint
from wbc.controllers.closed_loop import ticks_of
from wbc.controllers.contact_forces import ContactForces, Reaction
from wbc.controllers.dynamics import TickDynamics
from wbc.controllers.effort_bounds import StanceBraking, effort_bounds, limits_within
from wbc.controllers.force_ramps import ForceRamps
from wbc.controllers.joint_weights import JointWeights
from wbc.controllers.level_problem import Box, LevelProblem
from wbc.controllers.levels import Outcome
from wbc.controllers.look_ahead import Attempt, MarginRows, solve_with_cuts
from wbc.controllers.native_forces import TorqueRows
from wbc.controllers.native_given import GivenRows
from wbc.controllers.native_plan import NativePlan
from wbc.controllers.native_problem import NativeProblem
from wbc.controllers.native_tick import NativeController
from wbc.controllers.parts import ANOTHER, PLANNED, check_parts
from wbc.controllers.plan import Decision, Physics
from wbc.controllers.reachable import arrival_box, reachable_rows
from wbc.controllers.tick import Tick
from wbc.controllers.torque_tick import TorqueTick
from wbc.laws import Residual, Rows
from wbc.qp.backend import Backend, doubt_at_torque_level
from wbc.qp.solution import Status
from wbc.robot import Robot, Snapshot
from wbc.tasks.task import Task
from wbc.validate import Array, finite_number, read_only

BASE_FORCES = tuple(f"dynamics {row}" for row in ("fx", "fy", "fz", "mx", "my", "mz"))
POLICIES = ("damp", "raise")
# How long contacts take to come and go [s], unless told.
RAMP = 0.05
# Time constants of the last resort [s]: joints come to rest this fast, as far as torques go.
REST_TIME = 0.05


class TorqueController(NativeController):
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

    See :class:`~wbc.controllers.controller.Controller` for the others.

    Raises
    ------
    InvalidInputError
        A contact of which it is not known where its forces act, or a joint that follows another
        one and has an effort limit of its own to keep.
    """

    _fixed = PLANNED | dict.fromkeys(("torque_bounds", "force_damping"), ANOTHER)
    _policies = POLICIES
    _relaxes = True
    _bears = True

    def __init__(
        self,
        robot: Robot,
        tasks: Sequence[Task],
        *,
        contacts: Sequence[Task] | None = None,
        limits: Limits | None = None,
        constraints: Sequence[Constraint] = (),
        slack: Mapping[str, float] | None = None,
        dt: float = 0.002,
        solver: str | Backend = "proxqp",
        formulation: str = "equality",
        torque_limits: float | None = 1.0,
        damping: float = 1e-3,
        force_damping: float = 1e-2,
        force_ramp: float = RAMP,
        joint_weights: JointWeights | None = None,
        on_failure: str = "damp",
    ) -> None:
        for task in tasks:
            if isinstance(task, Task) and task.singular_threshold > 0.0:
                logging.getLogger(__name__).warning(
                    "controller: singular_threshold of %s has no effect at the torque level", task
                )
        self.force_damping = finite_number("controller, force_damping", force_damping, above=0.0)
        self.force_ramp = finite_number("controller, force_ramp", force_ramp, least=0.0)
        self.torque_bounds = effort_bounds(robot, torque_limits)
        self._braking = StanceBraking(robot, self.torque_bounds)
        self._last: Reaction | None = None
        self._ramps = ForceRamps(robot.weight)
        super().__init__(
            robot,
            tasks,
            contacts=contacts,
            limits=limits_within(limits, self.torque_bounds),
            constraints=constraints,
            slack=slack,
            dt=dt,
            solver=solver,
            formulation=formulation,
            damping=damping,
            joint_weights=joint_weights,
            on_failure=on_failure,
        )
        doubt = doubt_at_torque_level(self.backend)
        if doubt is not None:
            logging.getLogger(__name__).warning(
                "controller: %s; what it leaves, the core's 'active_set' answers", doubt
            )

    def set_contacts(self, contacts: Sequence[Task], ramp: float | None = None) -> None:
        """Change what is held; forces come and go over ``ramp`` seconds, so that no torque jumps.

        The largest normal force of a contact that is new grows from 0; that of one that is left
        out shrinks from what it bears, and only then it is dropped: until then it is held, with the
        slack that it had, and ``tick.ramps`` says so. Contacts with friction that were not there in
        the last tick are new; grips and other free forces come and go at once, and so does all
        before the first tick. Solvers keep their warm starts for each set of contacts.

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
        check_parts(self.robot, self.tasks, contacts, self.limits, self.constraints, self._slack)
        self._plan(self._next_contacts(tuple(contacts), ramp))

    def _step(self, snapshot: Snapshot) -> Tick:
        """Return the command: the tick of every controller, once what has gone is dropped."""
        gone = self._ramps.advance()
        if gone:
            left = tuple(one for one in self.contacts if one.name not in gone)
            self._keep_slack([one for one in left if one.name in self._going_slack])
            self._plan(left)
        return super()._step(snapshot)

    # ------------------------------------------------------------------ what the level says

    def _next_contacts(
        self, wanted: tuple[Task, ...], ramp: float | None = None
    ) -> tuple[Task, ...]:
        ramp = self.force_ramp if ramp is None else finite_number("contacts, ramp", ramp, least=0.0)
        loads = {} if self._last is None else self._last.normal_forces()
        held = self.contacts if self._last is not None else wanted
        changed = self._ramps.change(held, wanted, loads, ticks_of(ramp, self.dt))
        self._keep_slack(changed[len(wanted) :])
        return changed

    def _keep_slack(self, going: Sequence[Task]) -> None:
        """Let contacts that are leaving stay as soft as they were."""
        names, weights = {one.name for one in going}, self.slacks.weights
        self._going_slack = {name: weights[name] for name in names & weights.keys()}

    def _law(self, task: Task, residual: Residual, snapshot: Snapshot) -> Rows:
        drift = task.drift(snapshot)
        return task.acceleration_law.rows(residual, drift, snapshot.v, task.weight, self.dt)

    def _decision(self) -> Decision:
        robot = self.robot
        self._unit = robot.mass / self.dt  # N per unit of a force unknown
        self.contact_forces = forces = ContactForces(robot, self.contacts, self._unit)
        self._deceleration = self._braking.decelerations(self.limits, self.contacts)
        followers = [robot.joint_index(name) for name in robot.couplings]
        bounded = np.isfinite(self.torque_bounds)
        bounded[[k - 6 for k in followers]] = False
        self._bounded = 6 + np.flatnonzero(bounded)
        # Base, and joints without a motor of their own: no torque there.
        self._passive = np.array([*range(6), *followers])
        self._most = self.torque_bounds[bounded] / self._unit
        self._ends = np.stack((-self._most, self._most))
        self._torque_labels = tuple(f"{robot.joint_names[k - 6]} torque" for k in self._bounded)
        # As slices where it can be: what a tick takes by them is not copied.
        first = robot.nv - self._bounded.size
        every = self._bounded.tolist() == [*range(first, robot.nv)]
        self._torque_rows = slice(first, robot.nv) if every else self._bounded
        self._base_rows = self._passive if followers else slice(0, 6)
        self._met = read_only(np.ones(self._passive.size))
        velocity = Decision.velocity(robot, read_only(self.damping * self.joint_weights))
        damping = np.full(forces.size, self.force_damping)
        return velocity.extended(forces.names, forces.lower, forces.upper, damping)

    def _physics_names(self) -> tuple[str, ...]:
        followers = tuple(f"dynamics {name}" for name in self.robot.couplings)
        return BASE_FORCES + followers

    def _physics(self, snapshot: Snapshot) -> Physics:
        cones = self.contact_forces.bounds(self._ramps.most)
        nv, count = self.robot.nv, self._most.size
        # The torques' rows above those of the cones.
        rows = np.empty((nv + cones.lower.size, nv + self.contact_forces.size))
        rows[nv:, :nv] = 0.0
        rows[nv:, nv:] = cones.matrix
        dynamics = self._dynamics(snapshot).filling(rows[:nv])
        offset, bounded = dynamics.offset, self._torque_rows
        held = Rows(rows[self._base_rows], -offset[self._base_rows], self._met)
        ends = np.empty((2, count + cones.lower.size))
        np.subtract(self._ends, offset[bounded], out=ends[:, :count])
        ends[0, count:], ends[1, count:] = cones.lower, cones.upper
        if isinstance(bounded, slice):
            limited = rows[bounded.start :]
        else:
            limited = np.concatenate((rows[bounded], rows[nv:]))
        bounds = Bounds(self._torque_labels + cones.labels, limited, *ends)
        rest = np.zeros(rows.shape[1])
        rest[:nv] = snapshot.v
        forces = [task.force_rows(dynamics) for task in self._force_tasks]
        return Physics([held], bounds, forces=forces, rest=rest, dynamics=dynamics)

    def _native_parts(self) -> tuple[Sequence[Task], TorqueRows]:
        limits = self._bounded, self._most, self._torque_labels
        rows = TorqueRows(self.contact_forces, self._passive, *limits, self._deceleration)
        return (*self._motion, *self._force_tasks), rows

    def _native_problem(
        self, plan: NativePlan, snapshot: Snapshot, given: Sequence[GivenRows] | None = None
    ) -> NativeProblem | None:
        begun = perf_counter()
        rows = self._given_rows(plan, snapshot) if given is None else given
        return plan.problem(snapshot, self._ramps.most, rows, begun)

    def _given_rows(self, plan: NativePlan, snapshot: Snapshot) -> list[GivenRows]:
        found = super()._given_rows(plan, snapshot)
        if self._force_tasks:
            dynamics = self._dynamics(snapshot)
            for task in self._force_tasks:
                found.append(GivenRows(task.name, task.force_rows(dynamics), None))
        return found

    def _native_tick(self, found: NativeProblem, snapshot: Snapshot) -> Tick:
        velocity, torque, bounds = found.velocity, found.torque, self.torque_bounds
        np.minimum(np.maximum(torque, -bounds, out=torque), bounds, out=torque)
        self._last = Reaction(self.contact_forces, snapshot, found.forces)
        known: dict[str, Any] = self._known_errors(found, snapshot) if self._deviating else {}
        known |= {
            "torque": read_only(torque),
            "acceleration": read_only((velocity - snapshot.v) / self.dt),
            "reaction": self._last,
            "ramps": self._ramps.most,
        }
        return TorqueTick.reading(found, velocity, known)

    def _native_physics(self, found: NativeProblem, snapshot: Snapshot) -> Physics:
        known = found.matrix, found.offset
        dynamics = TickDynamics(snapshot, self.contact_forces, self._last_wrenches(), known)
        forces = [one.rows for one in found.given if one.residual is None]
        return Physics(bounds=found.bounds, forces=forces, dynamics=dynamics)

    def _dynamics(self, snapshot: Snapshot) -> TickDynamics:
        """Return what forces and torques are by the unknowns."""
        return TickDynamics(snapshot, self.contact_forces, self._last_wrenches())

    def _last_wrenches(self) -> Mapping[str, Array] | None:
        """Return what contacts bore in the last tick, if anyone may ask for it."""
        return self._last.wrenches() if self._force_tasks and self._last is not None else None

    # ------------------------------------------------------------------ parts of the tick

    def _limits_at(self, snapshot: Snapshot) -> tuple[Box, Rows | None]:
        if self.limits is None:
            return self._no_box, None
        return arrival_box(self.limits, snapshot, self._deceleration, self.dt), None

    def _attempt(self, problem: LevelProblem, margins: MarginRows | None) -> Attempt:
        if margins is None:
            return super()._attempt(problem, None)
        parts = [reachable_rows(part, problem.snapshot.v, self.dt) for part in margins.parts]
        solve, margins = partial(self._solver.solve, problem), margins._replace(parts=parts)
        outcome, rows, _ = solve_with_cuts(solve, margins)  # no part of a step is safer than all
        return Attempt(outcome, rows)

    def _settle(self, problem: LevelProblem, attempt: Attempt) -> Attempt:
        outcome = attempt.outcome
        relaxed = self._solver.solve_relaxed(self._without_least(problem), attempt.rows)
        spent = outcome.solve_time + relaxed.solve_time
        return Attempt(relaxed._replace(solve_time=spent), attempt.rows)

    def _without_least(self, problem: LevelProblem) -> LevelProblem:
        """Return the problem without least normal forces."""
        if (bounds := problem.physics.bounds) is None:
            return problem
        lower, begin = bounds.lower.copy(), self._bounded.size
        lower[begin : begin + len(self.contact_forces.surfaces)] = -np.inf
        physics = problem.physics._replace(bounds=bounds._replace(lower=lower))
        return problem._replace(physics=physics)

    def _tick(self, snapshot: Snapshot, physics: Physics, *parts: Any) -> TorqueTick:
        tick = super()._tick(snapshot, physics, *parts)
        dynamics = physics.dynamics or self._dynamics(snapshot)
        if tick.status is Status.SOLVED:
            x = dynamics.exact(tick.solution.x[: dynamics.size])
        else:  # joints come to rest, on no ground that one could count on
            x = np.concatenate((tick.velocity, np.zeros(self.contact_forces.size)))
        torque, bounds = dynamics.torques(x), self.torque_bounds
        np.minimum(np.maximum(torque, -bounds, out=torque), bounds, out=torque)
        velocity, f = x[: self.robot.nv], x[self.robot.nv :]
        errors = {  # of this decision: no state has a force
            task.name: self._unit * (row.matrix @ x - row.target)
            for task, row in zip(self._force_tasks, physics.forces, strict=True)
        }
        self._last = Reaction(self.contact_forces, snapshot, f)
        return TorqueTick.extending(
            tick,
            velocity=read_only(velocity),
            errors={**tick.errors, **errors},
            torque=read_only(torque),
            acceleration=read_only((velocity - snapshot.v) / self.dt),
            reaction=self._last,
            ramps=self._ramps.most,
        )

    def _fallback(self, snapshot: Snapshot, outcome: Outcome) -> tuple[Array, dict[str, float]]:
        """Return the velocity of a robot whose joints come to rest: the last resort."""
        velocity = snapshot.v.copy()
        velocity[6:] *= max(0.0, 1.0 - self.dt / REST_TIME)
        return velocity, {}
