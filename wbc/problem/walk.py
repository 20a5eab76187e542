"""A walk: a gait and a schedule of commands or footsteps, as a file describes them, and made."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal

from pydantic import Field

from wbc.constraints.friction import FrictionCone
from wbc.gait import Footstep, Legs, Velocity, Walker, WalkingWeights
from wbc.gait.phases import sole_poses
from wbc.gait.prescribed_steps import in_world
from wbc.gait.scheduled_walk import Forces, ScheduledWalk, TimedCommand
from wbc.gait.settings import GaitSettings
from wbc.gait.step_range import StepRange
from wbc.gait.walker import FRICTION
from wbc.problem.components import Parts
from wbc.problem.controller_spec import TorqueSpec
from wbc.problem.mistakes import Misplaced, Mistakes, read_section
from wbc.problem.section import (
    KeysOf,
    Name,
    NonEmpty,
    NonNegative,
    Number,
    Pair,
    Positive,
    Section,
    default_of,
)
from wbc.problem.source import Source
from wbc.problem.spec import AnyTask, PlainName, ProblemSpec
from wbc.problem.support import FrictionSpec, cone
from wbc.robot import Snapshot
from wbc.run.phase_support import Ground
from wbc.run.ramps import MinimumJerk


class CommandSpec(Section):
    """A velocity from some time on; what is left out is 0, so {at: 5} stops."""

    at: NonNegative
    """From when on [s]."""
    vx: Number = 0.0
    """Forwards [m/s]."""
    vy: Number = 0.0
    """To the left [m/s]."""
    yaw_rate: Number = 0.0
    """To the left [rad/s]."""

    @property
    def timed(self) -> TimedCommand:
        """The command."""
        return TimedCommand(self.at, Velocity(self.vx, self.vy, self.yaw_rate))


class FootstepSpec(Section):
    """Where a foot goes."""

    foot: Literal["left", "right"]
    """Which one; feet take turns."""
    x: Number
    """Of the middle of its sole [m]."""
    y: Number
    """To the left [m]."""
    yaw: Number = 0.0
    """Its heading, to the left [rad]."""
    duration: Positive | None = None
    """How long the other foot stands alone meanwhile [s]; as in the gait if left out."""
    z: Number | None = None
    """Height of the sole's middle [m]; left out: of the ground as it is felt."""
    slope: Pair | None = None
    """Rise over run of the ground below it along the axes of x and y; left out: as it is felt, or
    level, if z is given."""

    @property
    def footstep(self) -> Footstep:
        """The footstep."""
        return Footstep(**self.model_dump())


class GaitSpec(Section):
    """How a robot walks, and when where to; what is left out fits the robot's size."""

    commands: NonEmpty[CommandSpec] = ()
    """In order of time; each holds until the next. There must be commands, or footsteps."""
    footsteps: NonEmpty[FootstepSpec] = ()
    """Made one after the other from the start on; then it stands. A command ends them."""
    relative: bool = False
    """Whether a footstep is seen from the one before, in its axes, the first from the foot that
    stands; false: in the world."""
    single: Positive | None = None
    """How long it stands on one foot [s]."""
    double: Positive | None = None
    """How long it stands on both feet between steps [s]."""
    height: Positive | None = None
    """Of the CoM over the soles [m]."""
    width: Positive | None = None
    """Distance of the feet from each other [m]."""
    least_width: Positive | None = None
    """Least that a recovery step may leave of it [m]."""
    clearance: Positive | None = None
    """How high feet are lifted [m]."""
    ramp: Positive | None = None
    """How long a foot takes to bear its load and to give it up [s]."""
    acceleration: Positive | None = None
    """At which a commanded velocity is followed [m/s^2]."""
    gain: Positive | None = None
    """How far beyond the capture point the pressure goes, by its error."""
    feel: bool = True
    """Whether feet land when they feel the ground, by its true forces, without noise or delay, or
    with simulation.estimate by estimated ones; false: when they should."""
    see: bool = False
    """Whether feet on footsteps that are given clear the edges of the simulation's terrain; false:
    where heights are given, the highest of where a foot comes from, goes to and passes the other
    one may be anywhere between."""
    weights: Annotated[dict[str, Any], KeysOf(WalkingWeights)] = Field(default_factory=dict)
    """Weights of the walking tasks and their stiffness."""

    @property
    def settings(self) -> dict[str, float | None]:
        """Those of :class:`~wbc.gait.GaitSettings`."""
        others = {"commands", "footsteps", "relative", "feel", "see", "weights"}
        return self.model_dump(exclude=others)

    def check(
        self,
        start: Snapshot,
        legs: Legs,
        duration: float,
        ground: Ground | None,
        mistakes: Mistakes,
    ) -> None:
        """Note what shows only with the robot, and commands and footsteps that cannot be.

        ``ground`` is the height of the terrain, if it has any.
        """
        with mistakes.at("gait"):
            settings = GaitSettings.of(legs, **self.settings)
            if not self.commands and not self.footsteps:
                raise Misplaced("says not where to: give commands, or footsteps")
            for key in ("see", "relative"):
                if getattr(self, key) and not self.footsteps:
                    raise Misplaced("is about footsteps that are given, and none are", key)
            able = StepRange.of(start.robot, settings, legs)
            self._check_footsteps(start, able, ground if self.see else None, mistakes)
        with mistakes.at("gait", "weights"):
            WalkingWeights(**self.weights)
        last = -1.0
        for k, command in enumerate(self.commands):
            if command.at <= last:
                text = f"comes after the one at {last:g} s; order them by time"
                mistakes.note(("gait", "commands", k, "at"), text)
            elif command.at >= duration:
                text = f"is given after the end of the simulation ({duration:g} s)"
                mistakes.note(("gait", "commands", k, "at"), text)
            last = command.at

    def _check_footsteps(
        self, start: Snapshot, able: StepRange, ground: Ground | None, mistakes: Mistakes
    ) -> None:
        feet = sole_poses(start)
        given = [one.footstep for one in self.footsteps]
        world = in_world(given, feet) if self.relative else given
        for number, key, text in able.complaints(world, feet, ground=ground):
            mistakes.note(("gait", "footsteps", number, key), text)


class WalkControllerSpec(TorqueSpec):
    """Inverse dynamics by one quadratic program per tick."""

    level: Literal["torque"] = "torque"
    solver: Name = default_of(Walker, "solver")
    """The QP solver: active_set, proxqp, or any that qpsolvers finds installed."""


class WalkSpec(ProblemSpec):
    """A walk: a robot, a gait with commands, and what else it should do and respect."""

    gait: GaitSpec
    """How it walks, and where to."""
    support: Literal["double"] = "double"
    """A walk begins on both feet."""
    tasks: dict[PlainName, AnyTask] = Field(default_factory=dict)
    """What the robot should do besides walking; targets are relative to the start, in the world."""
    phases: None = None
    """A walk has none: it is led by commands."""
    controller: WalkControllerSpec = WalkControllerSpec()
    """How the tasks are turned into torques."""


def read_problem(source: Source) -> ProblemSpec:
    """Return what a robot's problem says: that of a walk if there is a ``gait``.

    Raises ProblemFileError: with every mistake found.
    """
    walks = isinstance(source.data, dict) and "gait" in source.data
    return read_section(WalkSpec if walks else ProblemSpec, source)


def walker_of(spec: WalkSpec, parts: Parts) -> Walker:
    """Return a walker at the start, with the problem's tasks, limits and constraints.

    Raises WbcError: a robot that cannot walk, or settings that do not fit it.
    """
    start = parts.at_start
    for one in parts.targeted:
        goal = one.goal(start, one.current(start))
        one.set_target(*MinimumJerk(goal, goal, 1.0, one.space).at(0.0))
    return Walker(
        parts.robot,
        spec.gait.settings,
        weights=WalkingWeights(**spec.gait.weights),
        posture=parts.start,
        friction=friction_of(spec),
        tasks=[one.task for one in parts.targeted if spec.tasks[one.task.name].active],
        limits=parts.limits,
        solver=spec.controller.backend(),
        **parts.constraints_and_slack(parts.contacts, start),
        **spec.controller.settings,
    )


def friction_of(spec: WalkSpec) -> FrictionCone:
    """Return what soles may bear: the controller's, with a walker's facets if it says none."""
    given = spec.controller.friction
    if isinstance(given, FrictionSpec) and "facets" in given.model_fields_set:
        return cone(given)
    return replace(cone(given), facets=FRICTION.facets)


def commanded_walk(spec: WalkSpec, parts: Parts, forces: Forces | None) -> ScheduledWalk:
    """Return what leads the walk; its feet feel ``forces``, unless they are not to feel any."""
    forces = forces if spec.gait.feel else None
    commands = [command.timed for command in spec.gait.commands]
    walker = walker_of(spec, parts)
    if spec.gait.footsteps:
        given = [one.footstep for one in spec.gait.footsteps]
        ground = spec.ground_height if spec.gait.see else None
        walker.follow(given, parts.at_start, relative=spec.gait.relative, ground=ground)
    moving = [target for one in parts.targeted if (target := one.moving(parts.at_start))]

    def move_to(time: float) -> None:
        parts.surroundings.move_to(time)
        for target in moving:
            target.move_to(time)

    return ScheduledWalk(walker, commands, forces, move_to)
