"""Constraints: a frame in a box, the CoM over the feet, no collisions, an upright trunk."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from wbc.constraints import (
    BrakingParameters,
    ComSupport,
    Contact,
    Limits,
    Obstacles,
    PositionBox,
    SelfCollision,
    TiltLimit,
)
from wbc.constraints.tilt_limit import TILT_BRAKING
from wbc.problem.constraint_spec import BuiltConstraint, ConstraintSpec
from wbc.problem.mistakes import Misplaced
from wbc.problem.section import (
    Components,
    ListOf,
    Name,
    Names,
    NonNegative,
    Point,
    Positive,
    Section,
    Three,
    Two,
    Words,
    default_of,
)
from wbc.robot import Snapshot
from wbc.robot.collision import Obstacle
from wbc.robot.collision.bodies import FITS
from wbc.run.phase_support import PhaseSupport

Pairs = Annotated[int, Field(ge=1, le=1000)]
LinkPairs = ListOf[Two[Name]]
SHAPES = ("sphere", "capsule", "box", "half_space")


class BoxSpec(ConstraintSpec):
    """Keep the origin of a frame in a box along the world's axes."""

    type: Literal["box"]
    frame: Name = "base"
    """A link, sole or other frame; base for the floating base."""
    lower: Components = (None, None, None)
    """Least x, y, z [m]; null: no bound."""
    upper: Components = (None, None, None)
    """Greatest x, y, z [m]; null: no bound."""

    def build(self, start: Snapshot, limits: Limits | None) -> BuiltConstraint:
        """Return the constraint."""
        lower = [-np.inf if end is None else end for end in self.lower]
        upper = [np.inf if end is None else end for end in self.upper]
        box = PositionBox(start.robot, self.frame, lower, upper, limits=limits)
        return BuiltConstraint(lambda *_: box)


class ComSupportSpec(ConstraintSpec):
    """Keep the CoM over the feet in contact."""

    type: Literal["com_support"]
    margin: NonNegative = default_of(ComSupport, "margin")
    """Distance from the edges of the support polygon [m]."""
    feet: Names | None = None
    """Feet of the support polygon; left out: those of the support in each phase."""

    def build(self, start: Snapshot, limits: Limits | None) -> BuiltConstraint:
        """Return the constraint for the feet in contact."""
        if self.feet is not None:
            ComSupport.over(start, self.feet, margin=self.margin)

        def during(snapshot: Snapshot, contacts: Sequence[Contact]) -> ComSupport | None:
            feet = self.feet or PhaseSupport.on("", contacts).feet
            return ComSupport.over(snapshot, feet, margin=self.margin) if feet else None

        return BuiltConstraint(during)


class ObstacleSpec(Section):
    """An obstacle: one of sphere, capsule, box, half_space."""

    sphere: Positive | None = None
    """Radius [m], about its position."""
    capsule: Two[Positive] | None = None
    """Radius, and length of the segment [m], which is vertical and centred at its position."""
    box: Three[Positive] | None = None
    """Sides [m] along x, y, z about its position."""
    half_space: Point | None = None
    """Outward normal of a wall through its position."""
    position: Point = (0.0, 0.0, 0.0)
    """Position at the start [m]."""
    velocity: Point = (0.0, 0.0, 0.0)
    """Velocity [m/s], world axes; must be zero with method global."""

    def build(self, name: str) -> Obstacle:
        """Return the obstacle in its own frame. Raises Misplaced: no shape, or several."""
        given = [shape for shape in SHAPES if getattr(self, shape) is not None]
        if len(given) != 1:
            raise Misplaced(f"needs one of {', '.join(SHAPES)}, and only one", "things", name)
        centre = np.zeros(3)
        if self.sphere is not None:
            return Obstacle.sphere(name, centre, self.sphere)
        if self.capsule is not None:
            radius, length = self.capsule
            half = np.array((0.0, 0.0, 0.5 * length))
            return Obstacle.capsule(name, -half, half, radius)
        if self.box is not None:
            return Obstacle.box(name, self.box)
        return Obstacle.half_space(name, np.array(self.half_space), 0.0)

    def move_to(self, obstacle: Obstacle, time: float) -> None:
        """Move the obstacle to its position at ``time`` [s]."""
        velocity = np.array(self.velocity)
        obstacle.move(np.eye(3), np.array(self.position) + time * velocity, velocity)


class ObstaclesSpec(ConstraintSpec):
    """Keep the robot away from obstacles."""

    type: Literal["obstacles"]
    things: Annotated[dict[Name, ObstacleSpec], Field(min_length=1)]
    """Obstacles by name."""
    margin: NonNegative = default_of(Obstacles, "margin")
    """Distance that is kept [m]."""
    links: Names = default_of(Obstacles, "links")
    """Links that must keep their distance, by name or pattern."""
    pairs: Pairs = default_of(Obstacles, "pairs")
    """How many pairs, the nearest of all, get a row in each tick."""
    fit: Annotated[str, Words(FITS)] = default_of(Obstacles, "fit")
    """What meshes are replaced by; hulls are closer and slower."""

    @property
    def moves(self) -> bool:
        """Whether an obstacle moves."""
        return any(any(thing.velocity) for thing in self.things.values())

    def build(self, start: Snapshot, limits: Limits | None) -> BuiltConstraint:
        """Return the constraint, with its obstacles at their initial positions."""
        things = [(spec, spec.build(name)) for name, spec in self.things.items()]
        for spec, obstacle in things:
            spec.move_to(obstacle, 0.0)
        settings = self.model_dump(exclude={"type", "slack", "things"})
        constraint = Obstacles(
            start.robot, [obstacle for _, obstacle in things], **settings, limits=limits
        )
        moving = [(spec, obstacle) for spec, obstacle in things if any(spec.velocity)]

        def move_to(time: float) -> None:
            for spec, obstacle in moving:
                spec.move_to(obstacle, time)

        return BuiltConstraint(lambda *_: constraint, move_to)

    def not_in_search(self) -> Iterator[Misplaced]:
        """Yield obstacles that move."""
        for name, thing in self.things.items():
            if any(thing.velocity):
                yield Misplaced(
                    "method global looks for a posture to rest in, and where this will be then "
                    "is not known; leave the velocity out, or give another controller.method",
                    "things",
                    name,
                    "velocity",
                )


class SelfCollisionSpec(ConstraintSpec):
    """Keep the robot's own bodies apart."""

    type: Literal["self_collision"]
    margin: NonNegative = default_of(SelfCollision, "margin")
    """Distance that is kept [m]."""
    pairs: Pairs = default_of(SelfCollision, "pairs")
    """How many pairs, the nearest of all, get a row in each tick."""
    fit: Annotated[str, Words(FITS)] = default_of(SelfCollision, "fit")
    """What meshes are replaced by; hulls are closer and slower."""
    include: LinkPairs = default_of(SelfCollision, "include")
    """Pairs of links to check, by name or pattern; left out: all that can collide."""
    exclude: LinkPairs = default_of(SelfCollision, "exclude")
    """Pairs of links not to check, by name or pattern."""

    def build(self, start: Snapshot, limits: Limits | None) -> BuiltConstraint:
        """Return the constraint."""
        settings = self.model_dump(exclude={"type", "slack"})
        constraint = SelfCollision(start.robot, **settings, limits=limits)
        return BuiltConstraint(
            lambda *_: constraint, unwatched=constraint.unseen | constraint.in_contact
        )


class TiltSpec(ConstraintSpec):
    """Keep the initially vertical axis of a frame within an angle of the vertical."""

    type: Literal["tilt"]
    frame: Name = "base"
    """A link or other frame, such as the trunk's; base for the floating base."""
    angle: Positive
    """Largest tilt [rad]."""
    braking: Positive = TILT_BRAKING
    """Deceleration assumed for braking before it [rad/s^2]."""

    def build(self, start: Snapshot, limits: Limits | None) -> BuiltConstraint:
        """Return the constraint."""
        braking = BrakingParameters(self.braking)
        constraint = TiltLimit.upright(start, self.frame, self.angle, braking=braking)
        return BuiltConstraint(lambda *_: constraint)
