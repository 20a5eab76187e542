"""Constraints as a problem file describes them: margins, obstacles, CoM support, boxes."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, Strict

from wbc.problem.section import Name, Names, NonNegative, Number, OneOf, Point, Positive, Section

_LinkPair = Annotated[tuple[Name, ...], Strict(False), Field(min_length=2, max_length=2)]
_LinkPairs = Annotated[tuple[_LinkPair, ...], Strict(False)]
_Ends = Annotated[tuple[Number | None, ...], Strict(False), Field(min_length=3, max_length=3)]
_Sizes = Annotated[tuple[Positive, ...], Strict(False), Field(min_length=3, max_length=3)]
_Count = Annotated[int, Field(ge=1, le=1000)]
_Feet = Annotated[tuple[Name, ...], Strict(False), Field(min_length=1)]


class _Constraint(Section):
    """What all constraints have."""

    slack: Positive | None = None
    """Weight of the squared slack [1/(m/s)^2] of a constraint that may give way; left out: hard.
    The search of method global knows those that are hard."""


class SelfCollisionSpec(_Constraint):
    """The robot's own bodies are kept apart."""

    type: Literal["self_collision"]
    margin: NonNegative = 0.01
    """Distance that is kept [m]."""
    pairs: _Count = 25
    """How many pairs, the nearest of all, get a row in each tick."""
    fit: Literal["capsule", "hull"] = "capsule"
    """What meshes are replaced by; hulls are closer and slower."""
    include: _LinkPairs = ()
    """Pairs of links, by name or pattern, to watch; left out: all that can meet."""
    exclude: _LinkPairs = ()
    """Pairs of links, by name or pattern, not to watch."""


class ObstacleSpec(Section):
    """Something that the robot must keep away from: one of sphere, capsule, box, half_space."""

    sphere: Positive | None = None
    """Radius [m], about its position."""
    capsule: Annotated[tuple[Positive, ...], Strict(False), Field(min_length=2, max_length=2)] | (
        None
    ) = None
    """Radius and length [m] of the segment, upright about its position."""
    box: _Sizes | None = None
    """Sides [m] along x, y, z about its position."""
    half_space: Point | None = None
    """Outward normal of a wall through its position."""
    position: Point = (0.0, 0.0, 0.0)
    """Where it is [m]."""
    velocity: Point = (0.0, 0.0, 0.0)
    """How it moves [m/s], world axes; with method global it must not."""


class ObstaclesSpec(_Constraint):
    """The robot is kept away from things around it."""

    type: Literal["obstacles"]
    things: Annotated[dict[Name, ObstacleSpec], Field(min_length=1)]
    """What is around, by name."""
    margin: NonNegative = 0.02
    """Distance that is kept [m]."""
    links: Names = ("*",)
    """Links that must keep away, by name or pattern."""
    pairs: _Count = 25
    """How many pairs, the nearest of all, get a row in each tick."""
    fit: Literal["capsule", "hull"] = "capsule"
    """What meshes are replaced by; hulls are closer and slower."""


class ComSupportSpec(_Constraint):
    """The CoM is kept over the feet that stand."""

    type: Literal["com_support"]
    margin: NonNegative = 0.01
    """Distance from the edges of the support polygon [m]."""
    feet: _Feet | None = None
    """The feet that count; left out: those that the support holds, phase by phase."""


class BoxSpec(_Constraint):
    """The origin of a frame is kept in a box along the world's axes."""

    type: Literal["box"]
    frame: Name = "base"
    """A link, sole or other frame; base for the floating base."""
    lower: _Ends = (None, None, None)
    """Least x, y, z [m]; null: no bound."""
    upper: _Ends = (None, None, None)
    """Greatest x, y, z [m]; null: no bound."""


ConstraintSpec = Annotated[
    SelfCollisionSpec | ObstaclesSpec | ComSupportSpec | BoxSpec,
    OneOf("type", "{type: box, upper: [null, null, 1]}"),
]
