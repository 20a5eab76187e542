"""A robot that walks at a velocity which may change at any time, or on footsteps.

    command -> footsteps -> DCM and VRP in closed form -> the next footstep, adapted (one small QP)
            -> centre of pressure, height, swing foot -> one torque tick

In single support the VRP is at the middle of the sole, or at an offset for weak ankles
(:func:`wbc.gait.ability.pressure_offset`); in double support it moves to the next one at a constant
rate. Footsteps beyond the next follow the velocity, and give the DCM relative to the next foot
(:mod:`wbc.gait.dcm`); place and time of its landing are adapted to the measured DCM
(:mod:`wbc.gait.adaptation`). The target of the centre of pressure is

    vrp + (1 + k) (xi - xi_ref),

projected onto the sole. Its task is about the contact forces, so that the swing leg's angular
momentum, which is of zero mean, needs no length of the sole (:class:`~wbc.gait.phases.GaitState`).
"""

from __future__ import annotations

import cmath
import logging
import math
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from inspect import signature
from operator import ge
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from wbc.constraints import Limits
from wbc.constraints.friction import FrictionCone
from wbc.constraints.rows import Constraint
from wbc.controllers.checks import check_list, check_snapshot
from wbc.controllers.torque import TorqueController
from wbc.controllers.torque_tick import TorqueTick
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.gait.adaptation import held_back_by
from wbc.gait.command import Admitted, CommandLimits, Velocity
from wbc.gait.dcm import in_plane
from wbc.gait.footsteps import SIGN, first_swing, other
from wbc.gait.legs import Legs, bearing_joints, heading_of
from wbc.gait.pace import Paces
from wbc.gait.phases import DoubleSupport, GaitState, Phase, SingleSupport, Standing, next_foot
from wbc.gait.prescribed_steps import WEIGHT_SHIFT, Footstep, Landing
from wbc.gait.push import PushObserver
from wbc.gait.reference import Reference, StepPlanner, sole_half_sizes
from wbc.gait.settings import GaitSettings
from wbc.gait.speed_monitor import SpeedMonitor
from wbc.gait.step_range import MAX_SLOPE, StepRange
from wbc.gait.swing import SwingMotion, towards, unit
from wbc.gait.whole_body import WalkingWeights, WholeBody
from wbc.kinds import check_kind
from wbc.qp.backend import Backend
from wbc.robot import Robot, Snapshot
from wbc.robot.notes import NOTED
from wbc.robot.postures import STANDING
from wbc.run.phase_support import Ground
from wbc.tasks.task import Task
from wbc.validate import Array, by_name, finite_number, finite_vector, plain_copy

# Largest change of the yaw rate [rad/s^2].
YAW_ACCELERATION = 2.0
# Rate of the critically damped spring by which the CoM's height follows the ground and the distance
# of the feet, in units of omega.
HEIGHT_RATE = 3.0
# s: straight knees are first bent by the posture task alone, then the CoM sinks. Sinking at once, a
# robot whose knees are a little past straight leant back by 0.5 rad.
BENDING_TIME, SINKING_TIME = 0.2, 0.5
# Filter gain per step of the ground's normal, for the normal of the stance sole: it may be on an
# edge.
NORMAL_GAIN = 0.2
# Settings for a speed are taken this many steps before it is reached.
PACE_LEAD_STEPS = 2.0
# A robot farther than this from the walker's nominal start begins where it is [m], [rad].
START_TOLERANCE = 0.1
# Soles of the posture may be tilted so far [degrees], as the steepest ground of a footstep is.
MAX_TILT = math.degrees(math.atan(MAX_SLOPE))
# Torques from this part of their limits on are at them.
AT_LIMIT = 1.0 - 1e-6
# A speed that is not sustained is reduced to this part of it, down to SLOW sqrt(g h).
SPEED_REDUCTION, SLOW = 0.8, 0.03
# Smallest vertical force that is assumed while the CoM sinks, as a ratio of the weight.
MIN_WEIGHT_SHARE = 0.5
# A robot that falls sideways needs half its weight as friction. An inscribed pyramid of four sides
# leaves 0.71 of it straight ahead and sideways, one of eight 0.92, in the same time.
FRICTION = FrictionCone(facets=8)
# Methods that are easily mistaken for attributes, and refuse to be assigned.
METHODS = frozenset(("command", "follow", "step", "prepare"))
# Kinds of attributes that may be assigned, with what is meant; others that would change nothing.
KINDS = {
    "limits": (CommandLimits, "dataclasses.replace(walker.limits, forwards=0.3)"),
    **dict.fromkeys(("velocity", "wanted"), (Velocity, "Velocity(0.3); or walker.command(0.3)")),
}
FIXED = frozenset(("robot", "gait", "controller", "dt"))
GUARDED = METHODS | KINDS.keys() | FIXED
# Settings of its controller that a walker is given by name; contacts are the walk's own.
SETTINGS = {*signature(TorqueController).parameters} - {"robot", "more", "contacts"}


class Walker:
    """Walks a robot: commands torques for the measured state.

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
        (nq,) target of the posture task, standing on both soles; None: the standing posture.
        Place and heading of the robot are measured in the first tick.
    friction:
        Friction cone of the soles.
    tasks, constraints:
        More of them, such as a :class:`~wbc.constraints.SelfCollision`.
    limits:
        Of the joints, for walking commands, too; the robot's own if None.
    dt:
        Period of the control loop [s].
    settings:
        Others of the :class:`~wbc.controllers.torque.TorqueController`, such as the ``delay`` of
        measured states and forces.

    Attributes
    ----------
    controller:
        The torque controller; :meth:`prepare` sets its goals.
    limits:
        Largest velocities, :class:`~wbc.gait.command.CommandLimits`.
    velocity:
        The present one, which follows the command.
    phase:
        The present one.
    steps:
        Number of steps made.
    coming:
        Prescribed footsteps that have not begun, in the world.
    landings:
        How far feet landed from prescribed footsteps.
    unadapted:
        Number of ticks in which the QP that adapts the footstep was not solved and the nominal one
        is made; a warning says so at the first.
    notes:
        What limits its legs in walking, in words; logged as warnings, too.

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
        for name in settings:
            if name not in SETTINGS:
                known = name in GaitSettings.__dataclass_fields__
                remedy = f"it is one of a gait: Walker(robot, {{{name!r}: ...}})" if known else ""
                every = SETTINGS | {*signature(Walker).parameters} - {"robot", "settings"}
                raise UnknownNameError("setting of a walker", name, sorted(every), remedy)
        check_kind("walker, limits", limits, Limits, "Limits(robot)", or_none=True)
        legs = Legs.of(robot, limits, settings.get("torque_limits", 1.0))
        check_kind("walker, weights", weights, WalkingWeights, "WalkingWeights()", or_none=True)
        check_list("tasks", tasks, Task)
        check_list("constraints", constraints, Constraint)
        self.robot = robot
        given = by_name("walker, gait", {} if gait is None else gait)
        nominal = GaitSettings.of(legs, **given)
        limits_of_legs = CommandLimits.of(legs, nominal)
        self.dt = finite_number("walker, dt", dt, above=0.0)
        start = robot.snapshot(robot.postures[STANDING] if posture is None else posture)
        self._frames = {foot: robot.feet[foot].frame for foot in robot.feet}
        weights = (weights or WalkingWeights()).for_legs(legs)
        self._planner = StepPlanner(nominal, limits_of_legs, legs, sole_half_sizes(robot))
        chosen = [name for name, value in given.items() if value is not None]
        self._paces = Paces.of(self._planner, weights, chosen)
        self.limits, self._nominal_height = self._paces.limits, self.gait.height
        self._range = StepRange.of(robot, self.gait, legs)
        now = GaitState.of(start, self._frames, self.gait.omega, self.gait.height)
        for foot, R in now.rotations.items():
            tilt = math.degrees(math.acos(min(R[2][2], 1.0)))
            if tilt > MAX_TILT:
                raise InvalidInputError(
                    f"walker, posture: the {foot} sole is tilted by {tilt:.0f} degrees; give a"
                    f" posture that stands on both, on ground of at most {MAX_TILT:.0f} degrees"
                    f" (a slope of {MAX_SLOPE:g}, rise over run)"
                )
        self.heading: float = heading_of(now.rotations.values())
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
        self._time_to_sink = BENDING_TIME + SINKING_TIME if self._whole_body.bends else 0.0
        self._sink_time = self._time_to_sink
        self.controller: TorqueController = self._whole_body.controller
        self.notes = self._whole_body.limitations
        self.wanted = self.velocity = Velocity()
        self.phase: Phase = Standing()
        self.steps = 0
        self.coming: tuple[Footstep, ...] = ()
        self._terrain: Ground | None = None
        self.landings: tuple[Landing, ...] = ()
        self.unadapted = 0
        self._push = PushObserver(self.gait.omega, self.gait.height)
        self._nominal_start: Array | None = now.middle
        self._places, self._jumped = now.places, False
        self._monitor = SpeedMonitor.of(self.gait.omega, self.gait.gravity)
        self._bearing = bearing_joints(robot)
        self._bearing_limits = (AT_LIMIT * self.controller.torque_bounds[self._bearing]).tolist()

    if not TYPE_CHECKING:  # a checker that sees this method lets every name be assigned

        def __setattr__(self, name: str, value: object) -> None:
            if name in GUARDED:
                self._check_assigned(name, value)
            object.__setattr__(self, name, value)

    def _check_assigned(self, name: str, value: object) -> None:
        if name in METHODS:  # walker.command = 0.3 would walk nowhere, in silence
            raise InvalidInputError(f"walker: {name} is called: walker.{name}({value!r})")
        if name in KINDS:
            check_kind(f"walker, {name}", value, *KINDS[name])
        elif "controller" in self.__dict__:
            raise InvalidInputError(f"walker: {name} cannot be assigned; make another Walker")

    def __copy__(self) -> Self:
        """Return a walker of the same robot, with its own state: both walk on from here."""
        return deepcopy(self, {id(self.robot): self.robot})

    def __repr__(self) -> str:
        vx, vy, yaw = self.velocity
        return (
            f"Walker({self.robot.name!r}, {type(self.phase).__name__}, {self.steps} steps,"
            f" v=({vx:.2f}, {vy:.2f}) m/s, {yaw:.2f} rad/s)"
        )

    @property
    def gait(self) -> GaitSettings:
        """The present settings, which follow the speed where they are not given."""
        return self._planner.gait

    @property
    def lasting_tasks(self) -> tuple[Task, ...]:
        """The tasks whose errors are meaningful in all phases."""
        return self._whole_body.lasting

    @property
    def held_back_by(self) -> tuple[str, ...]:
        """The active bounds of the next footstep, the strongest first; empty in a steady walk.

        Such as ``"reach of the legs ahead"``. Active motors and margins of the tick are in
        ``tick.active``, joints at their bounds in :func:`wbc.run.history.held_joints`.
        """
        if not isinstance(self.phase, SingleSupport):
            return ()
        return held_back_by(self.phase.multipliers, SIGN[other(self.phase.support)])

    def command(self, vx: float, vy: float = 0.0, yaw_rate: float = 0.0) -> Admitted:
        """Walk at this velocity from now on; zeros to stop.

        Return the velocity within the legs' limits, and the reason if it is less, which is logged.

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
            logging.getLogger(__name__).warning("walking command: %s", admitted.reason, extra=NOTED)
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

        A swing foot lands first. A step leaves its place only if neither the CoP within the sole
        nor the time of landing suffice for the capture point; see :attr:`landings`. A command, or
        other footsteps, replace those that remain.

        Parameters
        ----------
        snapshot:
            The robot's state.
        relative:
            Whether each is relative to the one before, the first to the stance foot.
        ground:
            Function of points (k, 2) that returns heights (k,) [m], such as
            :meth:`wbc.simulation.Terrain.height`: feet clear its edges. Without it the highest of
            start, goal and stance foot may be anywhere between.

        Raises
        ------
        InvalidInputError
            None at all; a foot that is not next; one out of reach, in too short a time, across the
            other foot or on it. The message names the value and its range.
        """
        check_snapshot(self.robot, snapshot)
        now = self._measured(snapshot)
        feet = self._planner.feet_after(self.phase, now, self.heading, self.velocity)
        begins = next_foot(self.phase)
        self.coming = self._range.admitted(
            footsteps, feet, begins, relative=relative, ground=ground
        )
        self._terrain = ground
        self.wanted, self.landings = Velocity(), ()
        return self.coming

    def step(self, snapshot: Snapshot, forces: Mapping[str, ArrayLike] | None = None) -> TorqueTick:
        """Return the command for a state; see :meth:`prepare`."""
        return self.prepare(snapshot, forces).step(snapshot)

    def prepare(
        self, snapshot: Snapshot, forces: Mapping[str, ArrayLike] | None = None
    ) -> TorqueController:
        """Set the targets of the next tick; return its controller.

        Parameters
        ----------
        forces:
            Wrench (6,) on each sole by its frame, world axes [N, N m], as
            :attr:`wbc.simulation.Plant.contact_forces`: touch-down is then measured. None: feet
            land at the planned time.
        """
        check_snapshot(self.robot, snapshot)
        dt, acceleration = self.dt, self.gait.acceleration
        now, wrenches = self._measured(snapshot), self._sole_wrenches(forces)
        if self._nominal_start is not None:
            self._match_start(snapshot, now, self._nominal_start)
        else:
            self._notice_jump(snapshot, now)
        self._places = now.places
        self._push = self._push.update(snapshot, now, wrenches, dt)
        if self.controller.delay:
            snapshot = self.controller.predicted(snapshot)
            now = self._measured(snapshot)
        now = self._push.predict(now, self.controller.delay)
        if self._whole_body.pressure_offset:
            dcm = now.dcm - self._pressure_shift
            now = now._replace(dcm=dcm, pressure_offset=self._whole_body.pressure_offset)
        on_steps = self._planner.velocity_on_steps(self.phase, now, self.heading)
        lands = bool(self.coming) and isinstance(self.phase, SingleSupport)  # where it was to
        wanted = on_steps or (self.velocity if lands else self.wanted)
        if self.velocity != wanted:
            change = acceleration * dt, YAW_ACCELERATION * dt
            self.velocity = self.velocity.towards(wanted, *change)
        self.heading += self._turn_rate * dt
        self._judge_strain()
        phase = self._next_phase(snapshot, now, wrenches)
        planner = self._planner
        if isinstance(phase, SingleSupport):
            phase = planner.adapt(phase, now, self.heading, self.velocity)
            self._count_unadapted(phase)
            phase, pose = planner.advance_swing(phase, now, self.heading, self.velocity, dt)
            exact, over = bool(phase.given), phase.swing.crossing is not None
            self._whole_body.swing(other(phase.support), pose, exact=exact, over=over)
            if wrenches:
                phase = phase.update(now, wrenches[phase.support], self.robot.weight)
            reference = planner.single_support(phase, now)
        elif isinstance(phase, DoubleSupport):
            reference = planner.double_support(phase, now, self.heading, self.velocity, self.coming)
        else:
            reference = planner.standing(now)
        self.phase = phase
        self._set_targets(snapshot, now, reference)
        return self.controller

    # ------------------------------------------------------------------ parts of a tick

    @property
    def _pressure_shift(self) -> complex:
        """Offset of the CoP from the soles' middles, as x + i y [m]."""
        return cmath.rect(self._whole_body.pressure_offset, self.heading)

    def _match_start(self, snapshot: Snapshot, now: GaitState, nominal_start: Array) -> None:
        """Begin where the robot stands, if that is not the walker's nominal start."""
        self._nominal_start, facing = None, heading_of(now.rotations.values())
        turn = abs(math.remainder(facing - self.heading, math.tau))
        if max(float(np.linalg.norm(now.middle - nominal_start)), turn) > START_TOLERANCE:
            self._begin_at(snapshot, now)
            return
        if self._sink_time:
            self._ground = SwingMotion.rest(float(snapshot.com[2]) - self._nominal_height)
        self._whole_body.hold(snapshot, self._frames, 0.0)

    def _begin_at(self, snapshot: Snapshot, now: GaitState) -> None:
        """Stand where the soles are from now on, and face as they do."""
        self.heading, self._sink_time = heading_of(now.rotations.values()), self._time_to_sink
        com_ground = float(snapshot.com[2]) - self._nominal_height
        self._ground = SwingMotion.rest(com_ground if self._sink_time else float(now.middle[2]))
        self._normal = unit(now.normal)
        self._whole_body.hold(snapshot, self._frames, 0.0)

    def _notice_jump(self, snapshot: Snapshot, now: GaitState) -> None:
        """Begin anew where a standing robot was put; say so, once, if it walked."""
        moved = max(map(math.dist, now.places.values(), self._places.values()))
        if moved <= START_TOLERANCE:
            return
        if isinstance(self.phase, Standing):
            self.controller.reset()
            self._push = PushObserver(self.gait.omega, self.gait.height)
            self._monitor = SpeedMonitor.of(self.gait.omega, self.gait.gravity)
            self._begin_at(snapshot, now)
        elif not self._jumped:
            self._jumped = True
            logging.getLogger(__name__).warning(
                "walker: a foot is %.2f m from where it was a tick before, and the walk goes on; if"
                " the robot was put elsewhere, make a new Walker",
                moved,
            )

    def _set_targets(self, snapshot: Snapshot, now: GaitState, reference: Reference) -> None:
        """Set the targets of CoM and trunk."""
        gait = self.gait
        vrp = reference.vrp + (1.0 + gait.gain) * (now.dcm - reference.dcm)
        if now.pressure_offset:
            vrp += self._pressure_shift
        reduction = self._planner.height_reduction(self.phase, now, self.heading)
        follow = HEIGHT_RATE * gait.omega
        lowering = self._nominal_height - gait.height + reduction
        level = reference.ground if reference.level is None else reference.level
        if self._sink_time > 0.0:
            if self._sink_time <= SINKING_TIME:
                self._ground = towards(self._ground, level - lowering, self._sink_time, self.dt)
            self._sink_time -= self.dt
        elif reference.level is None or reference.within is None:
            self._ground = self._ground.spring_towards(level - lowering, follow, self.dt)
        else:
            self._ground = towards(self._ground, level - lowering, reference.within, self.dt)
        if reference.level is not None:
            # At another height or vertical acceleration the DCM has the planned rate, that of a
            # constant omega, if the CoP's distance from the CoM is scaled by this ratio.
            com, g = snapshot.com, gait.gravity
            vertical = max(g + self._ground.acceleration, MIN_WEIGHT_SHARE * g)
            ratio = gait.omega**2 * (float(com[2]) - reference.ground) / vertical
            vrp = in_plane(com) + ratio * (vrp - in_plane(com))
        ground, *rates = self._ground
        height = SwingMotion(ground + self._nominal_height, *rates)
        place = self._planner.project_onto_support(self.phase, vrp, now)
        pressure = place.real, place.imag, reference.ground
        self._whole_body.set_targets(snapshot, pressure, height, self.heading, self._turn_rate)

    @property
    def _turn_rate(self) -> float:
        """How fast the heading turns [rad/s].

        It waits for a foot that is late: place and DCM of the landing are planned in its axes.
        """
        phase = self.phase
        waits = isinstance(phase, Standing) or (
            isinstance(phase, SingleSupport) and phase.swing.late > 0.0
        )
        return 0.0 if waits else self.velocity.yaw_rate

    def _judge_strain(self) -> None:
        """Slow down if hips or knees are at their torque limits for most of the time."""
        torque, push = self.controller.last_torque, abs(self._push.push)
        at_limit = torque is not None and any(
            map(ge, map(abs, torque[self._bearing].tolist()), self._bearing_limits)
        )
        self._monitor = self._monitor.update(at_limit, complex(*self.velocity[:2]), push, self.dt)
        if self._monitor.is_strained:
            why = "hips or knees are at their torque limits most of the time"
            self._slow_down(self._is_sideways, why)

    def _judge_step(self, snapshot: Snapshot) -> None:
        """Slow down if a step was made at another speed than commanded."""
        com, rate = in_plane(snapshot.com), self.velocity.yaw_rate
        ahead = cmath.rect(1.0, self.heading - 0.5 * rate * self._monitor.duration)
        outer, aside = abs(rate) * self.gait.width, self._is_sideways
        speed = self._monitor.deviation(com, ahead, outer, 1j if aside else 1.0)
        self._monitor = self._monitor.land(com)
        if speed is not None:
            self._slow_down(aside, f"a step was made at {speed:.2f} m/s")

    @property
    def _is_sideways(self) -> bool:
        """Whether the velocity to a side is a larger part of its limit than that forwards."""
        (vx, vy, _), limits = self.velocity, self.limits
        return abs(vy) * limits.forwards > abs(vx) * limits.sideways

    def _slow_down(self, aside: bool, why: str) -> None:
        """Reduce the largest speed forwards, or ``aside``, to a part of the present one."""
        speed, gait, limits = abs(self.velocity[aside]), self.gait, self.limits
        limit = SPEED_REDUCTION * speed
        on_steps = isinstance(self.phase, SingleSupport) and bool(self.phase.given)
        if on_steps or self.coming or abs(self.wanted[aside]) < speed:
            return  # footsteps are kept, and it slows down already
        axis = "sideways" if aside else "forwards"
        if limit >= getattr(limits, axis) or speed < SLOW * gait.gravity / gait.omega:
            return
        self._monitor = self._monitor.reduced()
        seen, (ahead, side, turning) = "speed that it was seen to sustain", limits.why
        why_limited = (ahead, seen, turning) if aside else (seen, side, turning)
        self.limits = replace(limits, **{axis: limit}, why=why_limited)
        self.wanted = self.limits.admit(*self.wanted).velocity
        told = f"{speed:.2f} m/s {'sideways ' * aside}was not sustained"
        note = f"{told}, {why}: at most {limit:.2f} m/s from then on"
        self.notes = (*self.notes, note)
        logging.getLogger(__name__).warning("walker: %s", note, extra=NOTED)

    def _count_unadapted(self, phase: SingleSupport) -> None:
        if phase.adapted:
            return
        if not self.unadapted:
            message = "walker: the QP of a footstep was not solved; the usual one is made instead"
            logging.getLogger(__name__).warning(message)
        self.unadapted += 1

    def _measured(self, snapshot: Snapshot) -> GaitState:
        return GaitState.of(snapshot, self._frames, self.gait.omega, self.gait.height)

    def _sole_wrenches(self, forces: Mapping[str, ArrayLike] | None) -> dict[str, Array]:
        """Return the wrenches (6,) on the soles, by foot; empty if they are not measured."""
        if forces is None:
            return {}
        quick = forces if type(forces) is dict else {}
        wrenches: dict[str, Array] = {}
        for foot, frame in self._frames.items():
            wrench = plain_copy(quick.get(frame), (6,))
            wrenches[foot] = _sole_wrench(forces, frame) if wrench is None else wrench
        return wrenches

    def _next_phase(self, snapshot: Snapshot, now: GaitState, loads: Mapping[str, Array]) -> Phase:
        """Return the phase a tick later, and change contacts where the phase changes."""
        phase, dt = self.phase, self.dt
        if isinstance(phase, Standing):
            if self.wanted.at_rest and not self.coming:
                return phase
            support = other(self.coming[0].foot if self.coming else first_swing(self.wanted))
            self._normal = unit(now.normal)
            self._whole_body.hold(snapshot, self._frames, self.gait.ramp)
            time = WEIGHT_SHIFT / self.gait.omega
            return DoubleSupport(support, in_plane(now.middle), time, time)
        if isinstance(phase, DoubleSupport):
            phase = phase._replace(left=phase.left - dt)
            if phase.halts:
                return Standing() if phase.left <= 0.0 else phase
            if phase.left <= self.gait.ramp and not phase.unloading:
                self._whole_body.hold(snapshot, [phase.support], self.gait.ramp)
                phase = phase._replace(unloading=True)
            return self._lift_off(phase, now) if phase.left <= 0.0 else phase
        phase = phase._replace(left=phase.left - dt, elapsed=phase.elapsed + dt)
        load = loads[other(phase.support)][2] / self.robot.weight if loads else None
        landed = self._planner.has_landed(phase, load, self.velocity)
        return self._land(snapshot, phase, now) if landed else phase

    def _lift_off(self, phase: DoubleSupport, now: GaitState) -> SingleSupport:
        foot = other(phase.support)
        sole = now.upwards(phase.support)  # settled by now
        self._normal = unit((1.0 - NORMAL_GAIN) * self._normal + NORMAL_GAIN * sole)
        given, self.coming = self.coming, self.coming[1:]
        self._set_pace(0.0 if given else self._speed_ahead())
        half = self._planner.soles[phase.support]
        over = None
        if given:
            base, before = now.pose(phase.support), now.pose(foot)
            over = self._range.crossing(given[0], base, before, self._terrain)
        return SingleSupport.lift_off(foot, now, self._normal, self.gait, half, given, over)

    def _speed_ahead(self) -> float:
        """Return the speed of the next steps, forwards or backwards [m/s].

        Settings change ahead of the speed, as the CoM takes most of a step to sink.
        """
        gait, now = self.gait, self.velocity
        change = PACE_LEAD_STEPS * gait.times.total * gait.acceleration
        return max(abs(now.vx), abs(now.towards(self.wanted, change, 0.0).vx))

    def _set_pace(self, speed: float) -> None:
        """Take the settings for a speed [m/s]; 0, the usual ones, on prescribed footsteps."""
        pace = self._paces.at(speed)
        if pace.planner is self._planner:
            return
        self._planner = pace.planner
        self._push = self._push._replace(omega=self.gait.omega, height=self.gait.height)
        self._whole_body.set_swing_weights(pace.swing, pace.lift)

    def _land(self, snapshot: Snapshot, phase: SingleSupport, now: GaitState) -> DoubleSupport:
        foot, start = other(phase.support), now.place(phase.support)
        self.steps += 1
        self._judge_step(snapshot)
        self._whole_body.hold(snapshot, self._frames, self.gait.ramp)
        if phase.given:
            self.landings = (*self.landings, Landing.of(phase.given[0], now.pose(foot)))
            if phase.given[0].normal is not None:
                self._normal = phase.given[0].normal
        stops = self.wanted.at_rest and not self.coming
        halts = stops and self._planner.can_halt(phase, now, self.heading, self.velocity)
        time = WEIGHT_SHIFT / self.gait.omega if halts else self._planner.double_time(phase, now)
        moves = time if halts or phase.level is None else self.gait.double
        return DoubleSupport(foot, start, moves, time, halts=halts, level=phase.level)


def _sole_wrench(forces: Mapping[str, ArrayLike], frame: str) -> Array:
    """Return the wrench (6,) on a sole, looked at closely."""
    given = by_name("walker, forces", forces)
    if frame not in given:
        raise InvalidInputError(
            f"walker, forces: there is none on {frame!r}, only on {', '.join(given)}"
            if given
            else "walker, forces: there are none; without any give None, not {}"
        )
    return finite_vector(f"walker, force on {frame!r}", given[frame], 6)
