"""A robot that walks at a velocity which may change at any time, or on footsteps.

    command -> footsteps -> DCM and VRP in closed form -> the next footstep, adapted (one small QP)
            -> centre of pressure, height, foot in the air -> one torque tick

While one foot bears, its VRP is at the middle of the sole, or where weak ankles bear
(:func:`wbc.gait.ability.pressed_ahead`); in the double support it moves to the next one at a
constant rate. Footsteps beyond the next follow the velocity, and give what the DCM should be
relative to the next foot (:mod:`wbc.gait.dcm`); where and when that lands is chosen for the DCM
that is measured (:mod:`wbc.gait.adaptation`). The centre of pressure is led to

    vrp + (1 + k) (xi - xi_ref),

within the sole: by a task about the forces, so that the angular momentum of the swinging leg, which
comes and goes by itself, takes nothing from the sole (:class:`~wbc.gait.phases.GaitState`).
"""

from __future__ import annotations

import cmath
import logging
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from wbc.constraints import Limits
from wbc.constraints.friction import FrictionCone
from wbc.constraints.rows import Constraint
from wbc.controllers.checks import check_list, check_snapshot
from wbc.controllers.torque import TorqueController
from wbc.controllers.torque_tick import TorqueTick
from wbc.errors import InvalidInputError
from wbc.gait.adaptation import held_back_by
from wbc.gait.command import Admitted, CommandLimits, Velocity
from wbc.gait.dcm import in_plane
from wbc.gait.footsteps import SIGN, first_swing, other
from wbc.gait.legs import Legs
from wbc.gait.pace import Paces
from wbc.gait.phases import (
    DoubleSupport,
    GaitState,
    Phase,
    SingleSupport,
    Standing,
    feet_after,
    next_foot,
)
from wbc.gait.prescribed_steps import SHIFT, Footstep, Landing
from wbc.gait.push import PushObserver
from wbc.gait.reference import Reference, StepPlanner, half_sizes
from wbc.gait.settings import GaitSettings
from wbc.gait.step_range import StepRange
from wbc.gait.swing import SwingMotion, towards, unit
from wbc.gait.whole_body import WalkingWeights, WholeBody, heading_of
from wbc.kinds import check_kind
from wbc.qp.backend import Backend
from wbc.robot import Robot, Snapshot
from wbc.robot.postures import STANDING
from wbc.run.phase_support import Ground
from wbc.tasks.task import Task
from wbc.validate import Array, by_name, finite_number, finite_vector, plain_copy

# Largest change of the yaw rate [rad/s^2].
TURN_UP = 2.0
# The CoM's height follows the ground, and how far apart feet are, as a critically damped spring of
# this rate, in units of omega.
FOLLOW = 3.0
# s: where knees stand straight they first bend, drawn by the posture alone, and then the CoM sinks.
# Asked to sink at once, a robot whose knees are a little past straight leant back by 0.5 rad.
BENDING, SINKING = 0.2, 0.5
# How much the sole that bears counts for the slope of the ground: it may be on an edge.
LEVELLING = 0.2
# So many steps before a speed is reached its settings are taken.
AHEAD_OF_PACE = 2.0
# A robot that is so far from where a walker was made for begins where it is [m], [rad].
ELSEWHERE = 0.1
# Of the robot's weight, what is counted on at least while the CoM sinks.
LIGHTEST = 0.5
# A robot that falls aside pushes the ground with half its weight. Of a pyramid of four sides inside
# the cone 0.71 of the friction is left straight ahead and aside, of eight 0.92, in the same time.
FRICTION = FrictionCone(facets=8)
# Methods that are easily taken for attributes, and refuse to be assigned.
CALLED = frozenset(("command", "follow", "step", "prepare"))


class Walker:
    """Walks a robot: commands torques for the state that is measured.

    Parameters
    ----------
    robot:
        With the feet ``left`` and ``right``.
    gait:
        Settings by name, see :class:`~wbc.gait.settings.GaitSettings`; the rest fits the robot.
    weights:
        Of the tasks; that of a foot's height is less where hips are weak
        (:meth:`~wbc.gait.WalkingWeights.for_legs`).
    posture:
        (nq,) what arms and trunk are drawn to; its soles are on the ground. The standing one,
        if None. Where the robot stands, and which way it faces, is measured in the first tick.
    friction:
        What soles may bear.
    tasks, constraints:
        More of them, such as a :class:`~wbc.constraints.SelfCollision`.
    limits:
        Of the joints, which walking commands keep, too; the robot's own if None.
    dt:
        Period of the control loop [s].
    settings:
        Others of the :class:`~wbc.controllers.torque.TorqueController`, such as the ``delay`` that
        states and forces are measured with.

    Attributes
    ----------
    controller:
        The torque controller; :meth:`prepare` sets its goals.
    gait, limits:
        Its settings, which follow the speed where they are not given
        (:class:`~wbc.gait.pace.Paces`), and largest velocities,
        :class:`~wbc.gait.command.CommandLimits`.
    velocity:
        At which it walks now; it follows what was commanded.
    phase:
        What it does now.
    steps:
        How many it has made.
    coming:
        Footsteps that were given and not begun yet, in the world.
    landings:
        How far feet landed from those that were.
    unadapted:
        In how many ticks the QP that adapts the footstep was not solved and the usual one is made;
        a warning says so at the first.
    notes:
        What its legs lack for walking, in words; warnings say so too.

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
        solver: str | Backend = "active_set",
        **settings: Any,
    ) -> None:
        check_kind("walker, limits", limits, Limits, "Limits(robot)", or_none=True)
        legs = Legs.of(robot, limits)
        check_kind("walker, weights", weights, WalkingWeights, "WalkingWeights()", or_none=True)
        check_list("tasks", tasks, Task)
        check_list("constraints", constraints, Constraint)
        self.robot = robot
        given = by_name("walker, gait", {} if gait is None else gait)
        self.gait = GaitSettings.of(legs, **given)
        limits_of_legs = CommandLimits.of(legs, self.gait)
        self.dt = finite_number("walker, dt", dt, above=0.0)
        start = robot.snapshot(robot.postures[STANDING] if posture is None else posture)
        self._frames = {foot: robot.feet[foot].frame for foot in robot.feet}
        weights = (weights or WalkingWeights()).for_legs(legs)
        self._planner = StepPlanner(self.gait, limits_of_legs, legs, half_sizes(robot))
        chosen = [name for name, value in given.items() if value is not None]
        self._paces = Paces.of(self._planner, weights, chosen)
        self.limits, self._usual = self._paces.limits, self.gait.height
        self._range = StepRange.of(robot, self.gait, limits)
        now = GaitState.of(start, self._frames, self.gait.omega, self.gait.height)
        self.heading = heading_of(now.rotations.values())
        self._ground = SwingMotion.rest(float(now.middle[2]))
        self._normal = unit(now.normal)
        self._whole_body = WholeBody(
            start,
            self.heading,
            self.gait.height,
            weights,
            friction,
            tasks=tasks,
            constraints=constraints,
            limits=limits or Limits(robot),
            dt=self.dt,
            solver=solver,
            **settings,
        )
        self._sinks = BENDING + SINKING if self._whole_body.bends else 0.0
        self.controller: TorqueController = self._whole_body.controller
        self.notes = self._whole_body.lacks
        self.wanted = self.velocity = Velocity()
        self.phase: Phase = Standing()
        self.steps = 0
        self.coming: tuple[Footstep, ...] = ()
        self._terrain: Ground | None = None
        self.landings: tuple[Landing, ...] = ()
        self.unadapted = 0
        self._push = PushObserver(self.gait.omega, self.gait.height)
        self._made_at: Array | None = now.middle

    if not TYPE_CHECKING:  # a checker that sees this method lets every name be assigned

        def __setattr__(self, name: str, value: object) -> None:
            if name in CALLED:  # walker.command = 0.3 would walk nowhere, in silence
                raise InvalidInputError(f"walker: {name} is called: walker.{name}({value!r})")
            object.__setattr__(self, name, value)

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

    @property
    def held_back_by(self) -> tuple[str, ...]:
        """What holds the next footstep back, the strongest first; empty in a steady walk.

        Such as ``"reach of the legs ahead"``. Motors and margins that hold the tick back are in
        ``tick.active``, joints at their bounds in :func:`wbc.run.history.held_joints`.
        """
        if not isinstance(self.phase, SingleSupport):
            return ()
        return held_back_by(self.phase.multipliers, SIGN[other(self.phase.support)])

    def command(self, vx: float, vy: float = 0.0, yaw_rate: float = 0.0) -> Admitted:
        """Walk at this velocity from now on; zeros to stop.

        Return the velocity that legs can do of it, and why it is not all. A warning says so too.

        Parameters
        ----------
        vx, vy, yaw_rate:
            Forwards and to the left [m/s], and turning to the left [rad/s].

        Raises
        ------
        InvalidInputError
            Not finite numbers.
        """
        admitted = self.limits.admit(vx, vy, yaw_rate)
        if admitted.reason:
            logging.getLogger(__name__).warning("walking command: %s", admitted.reason)
        self.wanted, self.coming = admitted.velocity, ()
        return admitted

    def follow(
        self,
        footsteps: Sequence[Footstep],
        snapshot: Snapshot,
        *,
        relative: bool = False,
        ground: Ground | None = None,
    ) -> tuple[Footstep, ...]:
        """Walk on footsteps from now on, and stop on the last; return them in the world.

        A foot in the air lands first. A step leaves its place only if neither the sole nor the time
        of the landing suffice for the capture point; see :attr:`landings`. A command, or other
        footsteps, take the place of those that are left.

        Parameters
        ----------
        snapshot:
            Where the robot is.
        relative:
            Whether each is seen from the one before, the first from the foot that stands.
        ground:
            The heights (k,) of what feet go over at points (k, 2) [m], such as
            :meth:`wbc.simulation.Terrain.height`: they clear its edges. Without it the highest of
            where a foot comes from, goes to and passes the other one may be anywhere between.

        Raises
        ------
        InvalidInputError
            None at all; a foot that is not next; one out of reach, in too short a time, across the
            other foot or on it. The message names the value and its range.
        """
        check_snapshot(self.robot, snapshot)
        feet = feet_after(self.phase, self._measured(snapshot), self.heading, self.velocity)
        begins = next_foot(self.phase)
        self.coming = self._range.admitted(
            footsteps, feet, begins, relative=relative, ground=ground
        )
        self._terrain = ground
        self.wanted, self.landings = Velocity(), ()
        return self.coming

    def step(self, snapshot: Snapshot, forces: Mapping[str, ArrayLike] | None = None) -> TorqueTick:
        """Return the command for ``snapshot``; see :meth:`prepare`."""
        return self.prepare(snapshot, forces).step(snapshot)

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
        check_snapshot(self.robot, snapshot)
        dt, acceleration = self.dt, self.gait.acceleration
        now, felt = self._measured(snapshot), self._felt(forces)
        if self._made_at is not None:
            self._begin(snapshot, now, self._made_at)
        self._push = self._push.seen(snapshot, now, felt, dt)
        if self.controller.delay:
            snapshot = self.controller.predicted(snapshot)
            now = self._measured(snapshot)
        now = self._push.ahead(now, self.controller.delay)
        if self._whole_body.ahead:
            now = now._replace(dcm=now.dcm - self._shift, ahead=self._whole_body.ahead)
        on_steps = self._planner.velocity_on_steps(self.phase, now, self.heading)
        wanted = on_steps or self.wanted
        self.velocity = self.velocity.towards(wanted, acceleration * dt, TURN_UP * dt)
        if not isinstance(self.phase, Standing):
            self.heading += self.velocity.yaw_rate * dt
        phase = self._next_phase(snapshot, now, felt)
        planner = self._planner
        if isinstance(phase, SingleSupport):
            phase = planner.adapted(phase, now, self.heading, self.velocity)
            self._count(phase)
            phase, pose = planner.swung(phase, now, self.heading, self.velocity, dt)
            exact, over = bool(phase.given), phase.swing.crossing is not None
            self._whole_body.swing(other(phase.support), pose, exact=exact, over=over)
            if felt:
                phase = phase.felt(now, felt[phase.support], self.robot.weight)
            reference = planner.single(phase, now)
        elif isinstance(phase, DoubleSupport):
            reference = planner.double(phase, now, self.heading, self.velocity, self.coming)
        else:
            reference = planner.standing(now)
        self.phase = phase
        self._lead(snapshot, now, reference)
        return self.controller

    # ------------------------------------------------------------------ parts of a tick

    @property
    def _shift(self) -> complex:
        """How far from the soles' middles the pressure is led, as x + i y [m]."""
        return cmath.rect(self._whole_body.ahead, self.heading)

    def _begin(self, snapshot: Snapshot, now: GaitState, made_at: Array) -> None:
        """Begin where the robot stands, if that is elsewhere than where its posture has it."""
        self._made_at, facing = None, heading_of(now.rotations.values())
        turn = abs(math.remainder(facing - self.heading, math.tau))
        if max(float(np.linalg.norm(now.middle - made_at)), turn) > ELSEWHERE:
            self.heading, self._ground = facing, SwingMotion.rest(float(now.middle[2]))
            self._normal = unit(now.normal)
            self._whole_body.hold(snapshot, self._frames, 0.0)
        if self._sinks:
            self._ground = SwingMotion.rest(float(snapshot.com[2]) - self._usual)

    def _lead(self, snapshot: Snapshot, now: GaitState, reference: Reference) -> None:
        """Set the goals of CoM and trunk."""
        vrp = reference.vrp + (1.0 + self.gait.gain) * (now.dcm - reference.dcm)
        if now.ahead:
            vrp += self._shift
        sunk = self._planner.sunk(self.phase, now, self.heading)
        follow = FOLLOW * self.gait.omega
        lower = self._usual - self.gait.height + sunk
        level = reference.ground if reference.level is None else reference.level
        if self._sinks > 0.0:
            if self._sinks <= SINKING:
                self._ground = towards(self._ground, level - lower, self._sinks, self.dt)
            self._sinks -= self.dt
        elif reference.level is None or reference.within is None:
            self._ground = self._ground.sprung(level - lower, follow, self.dt)
        else:
            self._ground = towards(self._ground, level - lower, reference.within, self.dt)
        if reference.level is not None:
            # The rate of the DCM is as planned, at a constant omega, if the pressure is so much
            # nearer to the CoM as the pendulum is shorter, or its weight more.
            com, g = snapshot.com, self.gait.gravity
            up = max(g + self._ground.acceleration, LIGHTEST * g)
            share = self.gait.omega**2 * (float(com[2]) - reference.ground) / up
            vrp = in_plane(com) + share * (vrp - in_plane(com))
        ground, *rates = self._ground
        height = SwingMotion(ground + self._usual, *rates)
        turn = 0.0 if isinstance(self.phase, Standing) else self.velocity.yaw_rate
        place = self._planner.within(self.phase, vrp, now)
        pressure = np.array((place.real, place.imag, reference.ground))
        self._whole_body.lead(snapshot, pressure, height, self.heading, turn)

    def _count(self, phase: SingleSupport) -> None:
        if not (phase.adapted or self.unadapted):
            told = "walker: the QP of a footstep was not solved; the usual one is made instead"
            logging.getLogger(__name__).warning(told)
        self.unadapted += not phase.adapted

    def _measured(self, snapshot: Snapshot) -> GaitState:
        return GaitState.of(snapshot, self._frames, self.gait.omega, self.gait.height)

    def _felt(self, forces: Mapping[str, ArrayLike] | None) -> dict[str, Array]:
        """Return the wrenches (6,) on the soles, by foot; none if they are not felt."""
        if forces is None:
            return {}
        given = by_name("walker, forces", forces)
        felt: dict[str, Array] = {}
        for foot, frame in self._frames.items():
            wrench = plain_copy(given.get(frame), (6,))
            if wrench is None:
                wrench = finite_vector(f"walker, force on {frame!r}", given.get(frame, ()), 6)
            felt[foot] = wrench
        return felt

    def _next_phase(self, snapshot: Snapshot, now: GaitState, felt: Mapping[str, Array]) -> Phase:
        """Return the phase a tick later, and change what is held where it ends."""
        phase, dt = self.phase, self.dt
        if isinstance(phase, Standing):
            if self.wanted.at_rest and not self.coming:
                return phase
            support = other(self.coming[0].foot if self.coming else first_swing(self.wanted))
            self._normal = unit(now.normal)
            self._whole_body.hold(snapshot, self._frames, self.gait.ramp)
            time = SHIFT / self.gait.omega
            return DoubleSupport(support, in_plane(now.middle), time, time)
        if isinstance(phase, DoubleSupport):
            phase = phase._replace(left=phase.left - dt)
            if phase.halts:
                return Standing() if phase.left <= 0.0 else phase
            if phase.left <= self.gait.ramp and not phase.unloading:
                self._whole_body.hold(snapshot, [phase.support], self.gait.ramp)
                phase = phase._replace(unloading=True)
            return self._lifted(phase, now) if phase.left <= 0.0 else phase
        phase = phase._replace(left=phase.left - dt, elapsed=phase.elapsed + dt)
        load = felt[other(phase.support)][2] / self.robot.weight if felt else None
        return self._landed(snapshot, phase, now) if self._planner.touches(phase, load) else phase

    def _lifted(self, phase: DoubleSupport, now: GaitState) -> SingleSupport:
        foot = other(phase.support)
        sole = now.rotations[phase.support][:, 2]  # it has settled now
        self._normal = unit((1.0 - LEVELLING) * self._normal + LEVELLING * sole)
        given, self.coming = self.coming, self.coming[1:]
        self._walk_at(0.0 if given else self._coming_speed())
        half = self._planner.soles[phase.support]
        over = None
        if given:
            base, before = now.pose(phase.support), now.pose(foot)
            over = self._range.crossing(given[0], base, before, self._terrain)
        return SingleSupport.begun(foot, now, self._normal, self.gait, half, given, over)

    def _coming_speed(self) -> float:
        """Return how fast it goes, forwards or backwards, in the steps that it begins with [m/s].

        The CoM takes most of a step to sink, so that begins before the speed is there.
        """
        gait, now = self.gait, self.velocity
        change = AHEAD_OF_PACE * gait.times.total * gait.acceleration
        return max(abs(now.vx), abs(now.towards(self.wanted, change, 0.0).vx))

    def _walk_at(self, speed: float) -> None:
        """Take the settings for a speed [m/s]; on footsteps that are given they are the usual."""
        pace = self._paces.at(speed)
        if pace.planner is self._planner:
            return
        self._planner, self.gait = pace.planner, pace.planner.gait
        self._push = self._push._replace(omega=self.gait.omega, height=self.gait.height)
        self._whole_body.weigh_swing(pace.swing, pace.lift)

    def _landed(self, snapshot: Snapshot, phase: SingleSupport, now: GaitState) -> DoubleSupport:
        foot, start = other(phase.support), now.place(phase.support)
        self.steps += 1
        self._whole_body.hold(snapshot, self._frames, self.gait.ramp)
        if phase.given:
            self.landings = (*self.landings, Landing.of(phase.given[0], now.pose(foot)))
            if phase.given[0].normal is not None:
                self._normal = phase.given[0].normal
        rests = self.wanted.at_rest and not self.coming
        halts = rests and self._planner.at_its_end(phase, now, self.heading, self.velocity)
        time = SHIFT / self.gait.omega if halts else self._planner.double_time(phase, now)
        moves = time if halts or phase.level is None else self.gait.double
        return DoubleSupport(foot, start, moves, time, halts=halts, level=phase.level)
