"""The robot, its start and its limits in a problem file: description, and making them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from wbc.constraints import Limits
from wbc.constraints.limits import BRAKING
from wbc.files import beside
from wbc.problem.mistakes import Misplaced, Mistakes
from wbc.problem.section import (
    Forms,
    Fraction,
    JointNumbers,
    KeysOf,
    ListOf,
    Name,
    Names,
    NonNegative,
    Number,
    Pair,
    Point,
    Positive,
    PositiveJointNumbers,
    PositiveOrInfinite,
    Section,
    Three,
    Two,
    Words,
    default_of,
)
from wbc.robot import FootSpec, Robot
from wbc.robot.formats.couplings import Loop
from wbc.robot.library import is_file_name
from wbc.robot.loops import KINDS
from wbc.validate import Array

Polygon = Annotated[ListOf[Pair], Field(min_length=3)]
FootKeys = Annotated[dict[str, Any], KeysOf(FootSpec, link=Name, polygon=Polygon, height=Number)]
LoopKeys = Annotated[
    dict[str, Any], KeysOf(Loop, frames=Two[Name], kind=Annotated[str, Words(KINDS)])
]


class PayloadSection(Section):
    """A rigid body that the robot carries; it touches nothing."""

    frame: Name
    """The link or frame that it is fixed to."""
    mass: Positive
    """[kg]."""
    com: Point = (0.0, 0.0, 0.0)
    """Its centre of mass [m], in the frame's axes from its origin."""
    inertia: Annotated[
        Point | Three[Point], Forms("the diagonal [xx, yy, zz], or three rows [[xx, xy, xz], ...]")
    ] = (0.0, 0.0, 0.0)
    """Its moments of inertia about its centre of mass, in the frame's axes [kg m^2]; left out: a
    point."""


class RobotSpec(Section):
    """A robot with settings of its own."""

    model: Name
    """A name that `wbc robots` lists, or a .urdf or .xml file, relative to this file."""
    locked: dict[Name, Number] = Field(default_factory=dict)
    """Joints to hold rigid, by name or pattern, and their values [rad or m]."""
    feet: dict[Name, FootKeys] | None = None
    """The feet by name (left, right, ...); guessed from the names of the links if missing."""
    base: Literal["floating", "fixed"] | None = None
    """fixed: bolted to the world; left out: fixed if there are no feet and the root link is called
    world, or base of what has no wheels and no links called feet, or carries a single arm; or if
    the root has no mass and moves by a joint."""
    srdf: Name | None = None
    """File with named postures, relative to this file."""
    package_dirs: Names | None = None
    """Folders to look for package:// meshes in, relative to this file."""

    armature: JointNumbers | None = None
    """Rotor inertia as felt at the joints [kg m^2, or kg where they slide], one number or by joint
    name or pattern; as in the robot's file where it is not given here."""
    damping: JointNumbers | None = None
    """Viscous friction of the joints [N m s/rad or N s/m], likewise."""
    friction: JointNumbers | None = None
    """Dry friction of the joints [N m or N], likewise."""
    effort: PositiveJointNumbers | None = None
    """Largest torque [N m] or force [N] of the joints, likewise."""
    loops: dict[Name, LoopKeys] | None = None
    """Closed loops by name, besides those of an MJCF."""
    unactuated: Names | None = None
    """Joints without a motor, by name or pattern; left out: those that no motor of an MJCF with
    closed loops drives."""

    payload: ListOf[PayloadSection] = ()
    """Bodies that it carries."""

    def load(self, folder: Path) -> Robot:
        """Return the robot; relative paths start from ``folder``.

        Raises WbcError: no such robot, or one that cannot be used.
        """
        robot = Robot.load(
            beside(folder, self.model) if is_file_name(self.model) else self.model,
            locked=self.locked,
            feet=self.feet,
            base=self.base,
            srdf=None if self.srdf is None else beside(folder, self.srdf),
            package_dirs=[beside(folder, name) for name in self.package_dirs or ()],
            armature=self.armature,
            damping=self.damping,
            friction=self.friction,
            effort=self.effort,
            loops=self.loops or {},
            unactuated=self.unactuated,
        )
        for body in self.payload:
            robot = robot.with_payload(**body.model_dump())
        return robot


RobotChoice = Annotated[
    Name | RobotSpec, Forms("a robot's name, a .urdf or .xml file, or {model: ..., locked: ...}")
]


class StartSpec(Section):
    """Where the robot starts."""

    posture: Name = "standing"
    """A posture of the robot: neutral, standing, or one from its SRDF."""
    joints: dict[Name, Number] = Field(default_factory=dict)
    """Joint values [rad or m] by name or pattern, over those of the posture."""
    on_ground: bool = True
    """Whether the lowest sole is put on the ground, z = 0; false: the base stays where the posture
    has it, as of a robot that stands on its hands or knees."""
    motion: Name | None = None
    """Where a standing motion begins, in place of a posture: a .npz file that `wbc retarget` wrote,
    relative to this file."""

    def configuration(self, robot: Robot, folder: Path) -> Array:
        """Return the configuration (nq,); relative paths start from ``folder``.

        Raises WbcError: no such motion, or one of another robot; a posture or joints besides it.
        """
        if self.motion is None:
            return robot.posture(self.posture, self.joints, self.on_ground)
        for key in ("posture", "joints", "on_ground"):
            if key in self.model_fields_set:
                raise Misplaced("the robot starts where the motion begins; leave this out", key)
        from wbc.retargeting.standing import StandingMotion  # only now: it loads SciPy

        return StandingMotion.read(beside(folder, self.motion), robot).start

    def check(self, robot: Robot, mistakes: Mistakes) -> None:
        """Note a posture or joints that ``robot`` does not have."""
        with mistakes.at("start", "posture"):
            robot.posture(self.posture)
        for pattern, value in self.joints.items():  # one by one, so that each mistake has its line
            with mistakes.at("start", "joints", pattern):
                robot.posture(joints={pattern: value})


class LimitsSpec(Section):
    """Limits of joints and base; on by default."""

    position: bool = default_of(Limits, "position")
    """Keep joints inside the model's position limits."""
    margin: NonNegative = default_of(Limits, "margin")
    """Distance to keep from them [rad or m]."""
    velocity: Positive | None = default_of(Limits, "velocity")
    """Factor on the model's velocity limits; null: no velocity limit."""
    acceleration: PositiveJointNumbers | None = None
    """Largest acceleration [rad/s^2 or m/s^2], one number or by joint name or pattern; where none
    is given, the velocity limit divided by 0.1 s."""
    braking: Annotated[str, Words(BRAKING)] = default_of(Limits, "braking")
    """free: a joint may stop in one tick; bounded: it slows down by no more than the acceleration,
    except where limits, contacts or margins leave nothing else, and far from their targets tasks
    pull with lower gains, so that they do not overshoot."""
    base_twist: Annotated[ListOf[PositiveOrInfinite], Field(min_length=6, max_length=6)] | None = (
        None
    )
    """Largest base velocity in base axes, three linear [m/s] then three angular [rad/s]; .inf: no
    limit."""
    recovery: Fraction = default_of(Limits, "recovery")
    """Fraction of a violation to take back in one tick, in (0, 1]."""

    def build(self, robot: Robot) -> Limits:
        """Return the limits.

        Raises WbcError: a joint that does not exist, or a margin that leaves no range.
        """
        values = self.model_dump(exclude={"acceleration"})
        if isinstance(self.acceleration, float | int | None):
            return Limits(robot, acceleration=self.acceleration, **values)
        acceleration = Limits(robot, **values).acceleration.copy()
        for pattern, value in self.acceleration.items():
            acceleration[np.array(robot.joint_indices(pattern)) - 6] = value
        return Limits(robot, acceleration=acceleration, **values)


LimitsChoice = Annotated[
    Literal["none"] | LimitsSpec,
    Forms("none, or keys such as margin: and velocity: (leave limits out for the defaults)"),
]
