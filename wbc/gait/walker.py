"""A robot that walks at a velocity which may change at any time.

    command -> footsteps -> DCM and VRP in closed form -> the next footstep, adapted (one small QP)
            -> centre of pressure, height, foot in the air -> one torque tick

While one foot bears, its VRP is at the middle of the sole; in the double support it moves to the
next one at a constant rate. Footsteps beyond the next follow the velocity, and give what the DCM
should be relative to the next foot (:mod:`wbc.gait.dcm`); where and when that lands is chosen for
the DCM that is measured (:mod:`wbc.gait.adaptation`). The centre of pressure is led to

    vrp + (1 + k) (xi - xi_ref),

within the sole: by a task about the forces, so that the angular momentum of the swinging leg, which
comes and goes by itself, takes nothing from the sole (:class:`~wbc.gait.phases.Measured`).
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from wbc.constraints import Limits
from wbc.constraints.friction import FrictionCone
from wbc.constraints.rows import Constraint
from wbc.controllers.torque import TorqueController
from wbc.controllers.torque_tick import TorqueTick
from wbc.gait.command import Admitted, CommandLimits, Velocity
from wbc.gait.footsteps import first_swing, other
from wbc.gait.phases import DoubleSupport, Measured, Phase, SingleSupport, Standing
from wbc.gait.reference import Reference, StepPlanner
from wbc.gait.settings import GaitSettings
from wbc.gait.swing import Motion, SwingFoot, yaw_of
from wbc.gait.whole_body import WalkingWeights, WholeBody, heading_of
from wbc.qp.backend import Backend
from wbc.robot import Robot, Snapshot
from wbc.robot.legs import Legs
from wbc.robot.postures import STANDING
from wbc.tasks.task import Task
from wbc.validate import Array, finite_number

# A foot that bears this part of the weight has landed, if it has done so much of its way: what it
# bumps into before is an edge.
TOUCH, DONE = 0.1, 0.7
# A foot that does not find the ground goes on down at this speed, in units of height times omega,
# for so long, in units of 1/omega; then it counts as landed.
DESCENT, LATEST = 0.08, 1.2
# How long the first shift of the weight takes, and the last one, in units of 1/omega.
SHIFT = 1.2
# A step at rest ends the walk if it is this near to its place [m].
BESIDE = 0.03
# Largest change of the yaw rate [rad/s^2].
TURN_UP = 2.0
# The CoM's height follows the ground, and how far apart feet are, as a critically damped spring of
# this rate, in units of omega.
FOLLOW = 3.0
# How much the sole that bears counts for the slope of the ground: it may be on an edge.
LEVELLING = 0.2
FRICTION = FrictionCone()


class Walker:
    """Walks a robot: commands torques for the state that is measured.

    Parameters
    ----------
    robot:
        With the feet ``left`` and ``right``.
    gait:
        Settings by name, see :class:`~wbc.gait.settings.GaitSettings`; the rest fits the robot.
    weights:
        Of the tasks.
    posture:
        (nq,) what arms and trunk are drawn to; its soles are on the ground. The standing one,
        if None.
    friction:
        What soles may bear.
    tasks, constraints:
        More of them, such as a :class:`~wbc.constraints.SelfCollision`.
    limits:
        Of the joints; the robot's own if None.
    dt:
        Period of the control loop [s].
    settings:
        Others of the :class:`~wbc.controllers.torque.TorqueController`.

    Attributes
    ----------
    controller:
        The torque controller; :meth:`prepare` sets its goals.
    gait:
        The :class:`~wbc.gait.settings.GaitSettings`.
    limits:
        Largest velocities, :class:`~wbc.gait.command.CommandLimits`.
    velocity:
        At which it walks now; it follows what was commanded.
    phase:
        What it does now.
    steps:
        How many it has made.

    Raises
    ------
    InvalidInputError
        A robot without two feet, or a setting out of range; the message gives the range.
    UnknownNameError
        No such setting.
    """

    def __init__(
        self,
        robot: Robot,
        gait: Mapping[str, float | None] | None = None,
        *,
        weights: WalkingWeights | None = None,
        posture: ArrayLike | None = None,
        friction: FrictionCone = FRICTION,
        tasks: Sequence[Task] = (),
        constraints: Sequence[Constraint] = (),
        limits: Limits | None = None,
        dt: float = 0.002,
        solver: str | Backend = "daqp",
        **settings: Any,
    ) -> None:
        legs = Legs.of(robot)
        self.robot = robot
        self.gait = GaitSettings.of(legs, **(gait or {}))
        self.limits = CommandLimits.of(legs, self.gait)
        self.dt = finite_number("walker, dt", dt, above=0.0)
        start = robot.snapshot(robot.postures[STANDING] if posture is None else posture)
        self._frames = {foot: robot.feet[foot].frame for foot in robot.feet}
        self._planner = StepPlanner(self.gait, self.limits, legs, _half_sizes(robot))
        now = Measured.of(start, self._frames, self.gait.omega, self.gait.height)
        self.heading = heading_of(now.rotations.values())
        self._ground = Motion.rest(np.array((now.middle[2],)))
        self._normal = _unit(now.normal)
        self._whole_body = WholeBody(
            start,
            self.heading,
            self.gait.height,
            weights or WalkingWeights(),
            friction,
            tasks=tasks,
            constraints=constraints,
            limits=limits or Limits(robot),
            dt=self.dt,
            solver=solver,
            **settings,
        )
        self.controller: TorqueController = self._whole_body.controller
        self.wanted = self.velocity = Velocity()
        self.phase: Phase = Standing()
        self.steps = 0

    def __repr__(self) -> str:
        vx, vy, yaw = self.velocity
        return (
            f"Walker({self.robot.name!r}, {type(self.phase).__name__}, {self.steps} steps,"
            f" v=({vx:.2f}, {vy:.2f}) m/s, {yaw:.2f} rad/s)"
        )

    @property
    def lasting_tasks(self) -> tuple[Task, ...]:
        """The tasks whose errors mean something all the time: those of one phase left out."""
        return self._whole_body.lasting

    def command(self, vx: float, vy: float = 0.0, yaw_rate: float = 0.0) -> Admitted:
        """Walk at this velocity from now on; zeros to stop.

        Return the velocity that legs can do of it, and why it is not all. A warning says so too.

        Parameters
        ----------
        vx, vy:
            Forwards and to the left [m/s].
        yaw_rate:
            To the left [rad/s].

        Raises
        ------
        InvalidInputError
            Not finite numbers.
        """
        admitted = self.limits.admit(vx, vy, yaw_rate)
        if admitted.reason:
            logging.getLogger(__name__).warning("walking command: %s", admitted.reason)
        self.wanted = admitted.velocity
        return admitted

    def step(self, snapshot: Snapshot, forces: Mapping[str, ArrayLike] | None = None) -> TorqueTick:
        """Return the command for ``snapshot``; see :meth:`prepare`."""
        return cast(TorqueTick, self.prepare(snapshot, forces).step(snapshot))

    def prepare(
        self, snapshot: Snapshot, forces: Mapping[str, ArrayLike] | None = None
    ) -> TorqueController:
        """Set the goals of the tick that follows; return the controller that makes it.

        Parameters
        ----------
        forces:
            Wrench (6,) on each sole by its frame, world axes [N, N m], as
            :attr:`wbc.simulation.Plant.contact_forces`: feet then land when they touch. None: they
            land when they should.
        """
        gait, planner, dt = self.gait, self._planner, self.dt
        now = Measured.of(snapshot, self._frames, gait.omega, gait.height)
        self.velocity = self.velocity.towards(self.wanted, gait.acceleration * dt, TURN_UP * dt)
        if not isinstance(self.phase, Standing):
            self.heading += self.velocity.yaw_rate * dt
        phase = self._next_phase(snapshot, now, forces)
        if isinstance(phase, SingleSupport):
            phase = planner.adapted(phase, now, self.heading, self.velocity)
            phase = self._swung(phase, now)
            reference = planner.single(phase, now)
        elif isinstance(phase, DoubleSupport):
            reference = planner.double(phase, now, self.heading, self.velocity)
        else:
            reference = planner.standing(now)
        self.phase = phase
        self._lead(snapshot, now, reference)
        return self.controller

    # ------------------------------------------------------------------ parts of a tick

    def _lead(self, snapshot: Snapshot, now: Measured, reference: Reference) -> None:
        """Set the goals of CoM and trunk."""
        rate = FOLLOW * self.gait.omega
        vrp = reference.vrp + (1.0 + self.gait.gain) * (now.dcm - reference.dcm)
        z, z1, _ = self._ground
        sunk = self._planner.sunk(self.phase, now, self.heading)
        z2 = rate**2 * (reference.ground - sunk - z) - 2.0 * rate * z1
        z1 = z1 + z2 * self.dt
        self._ground = Motion(z + z1 * self.dt, z1, z2)
        height = np.concatenate(self._ground) + (self.gait.height, 0.0, 0.0)
        turn = 0.0 if isinstance(self.phase, Standing) else self.velocity.yaw_rate
        pressure = np.append(self._within(vrp, now), reference.ground)
        self._whole_body.lead(snapshot, pressure, height, self.heading, turn)

    def _within(self, vrp: Array, now: Measured) -> Array:
        """Return the point (2,) nearest to ``vrp`` on the sole that bears alone."""
        phase = self.phase
        if not isinstance(phase, SingleSupport):
            return vrp
        R, place = now.rotations[phase.support][:2, :2], now.places[phase.support][:2]
        half = self._planner.soles[phase.support]
        return place + R @ np.clip(R.T @ (vrp - place), -half, half)

    def _swung(self, phase: SingleSupport, now: Measured) -> SingleSupport:
        """Return the phase with the foot in the air led on by a tick."""
        left = max(phase.left, 0.0)
        goal = np.array((*phase.goal, self.heading + self.velocity.yaw_rate * left))
        swing = phase.swing.advanced(goal, phase.left, self.dt)
        x, y, z = phase.swing.normal.tolist()
        dx, dy = (phase.goal - now.places[phase.support][:2]).tolist()
        ground = float(now.places[phase.support][2]) - (x * dx + y * dy) / z
        self._whole_body.swing(other(phase.support), swing.pose(ground, left))
        return replace(phase, swing=swing)

    def _next_phase(
        self, snapshot: Snapshot, now: Measured, forces: Mapping[str, ArrayLike] | None
    ) -> Phase:
        """Return the phase a tick later, and change what is held where it ends."""
        phase, dt = self.phase, self.dt
        if isinstance(phase, Standing):
            if self.wanted.at_rest:
                return phase
            support = other(first_swing(self.wanted))
            self._normal = _unit(now.normal)
            self._whole_body.hold(snapshot, self._frames, self.gait.ramp)
            time = SHIFT / self.gait.omega
            return DoubleSupport(support, now.middle[:2], time, time)
        if isinstance(phase, DoubleSupport):
            phase = replace(phase, left=phase.left - dt)
            if phase.halts:
                return Standing() if phase.left <= 0.0 else phase
            if phase.left <= self.gait.ramp and not phase.unloading:
                self._whole_body.hold(snapshot, [phase.support], self.gait.ramp)
                phase = replace(phase, unloading=True)
            return self._lifted(phase, now) if phase.left <= 0.0 else phase
        phase = replace(phase, left=phase.left - dt, elapsed=phase.elapsed + dt)
        return self._landed(snapshot, phase, now) if self._touches(phase, forces) else phase

    def _touches(self, phase: SingleSupport, forces: Mapping[str, ArrayLike] | None) -> bool:
        """Return whether the foot in the air has landed."""
        if forces is None:
            return phase.left <= 0.0
        swing = phase.swing
        load = float(np.asarray(forces[self._frames[other(phase.support)]])[2])
        pressed = swing.done > DONE and load > TOUCH * self.robot.weight
        return pressed or swing.late > LATEST / self.gait.omega

    def _lifted(self, phase: DoubleSupport, now: Measured) -> SingleSupport:
        """Return the single support that begins."""
        foot, gait = other(phase.support), self.gait
        sole = now.rotations[phase.support][:, 2]  # it has settled now
        self._normal = _unit((1.0 - LEVELLING) * self._normal + LEVELLING * sole)
        place, yaw = now.places[foot], yaw_of(now.rotations[foot])
        swing = SwingFoot(
            Motion.rest(np.array((place[0], place[1], yaw))),
            float(place[2]),
            self._normal,
            gait.clearance,
            DESCENT * gait.height * gait.omega,
        )
        return SingleSupport(phase.support, swing, 0.0, gait.single, place[:2], np.zeros(2))

    def _landed(self, snapshot: Snapshot, phase: SingleSupport, now: Measured) -> DoubleSupport:
        """Return the double support that begins."""
        gait, foot = self.gait, other(phase.support)
        self.steps += 1
        self._whole_body.hold(snapshot, self._frames, gait.ramp)
        start, place = now.places[phase.support][:2], now.places[foot][:2]
        rest = self.wanted.at_rest and self.velocity.at_rest
        nominal = start + self._planner.footsteps.step(phase.support, self.heading, self.velocity)
        if rest and float(np.linalg.norm(place - nominal)) < BESIDE:
            time = SHIFT / gait.omega
            return DoubleSupport(foot, start, time, time, halts=True)
        duration = self._planner.double_time(phase)
        return DoubleSupport(foot, start, duration, duration)


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))


def _half_sizes(robot: Robot) -> dict[str, Array]:
    """Return how far each sole reaches from its middle (2,) [m], the lesser of both ways."""
    return {
        name: np.minimum(foot.polygon.max(axis=0), -foot.polygon.min(axis=0))
        for name, foot in robot.feet.items()
    }
