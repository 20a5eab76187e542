"""The robot's own bodies kept apart."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from wbc.constraints import Limits, SelfCollision
from wbc.problem.constraint_spec import BuiltConstraint, ConstraintSpec
from wbc.problem.section import ListOf, Name, NonNegative, Two, Words, default_of
from wbc.robot import Snapshot
from wbc.robot.collision.bodies import FITS

LinkPairs = ListOf[Two[Name]]


class SelfCollisionSpec(ConstraintSpec):
    """The robot's own bodies are kept apart."""

    type: Literal["self_collision"]
    margin: NonNegative = default_of(SelfCollision, "margin")
    """Distance that is kept [m]."""
    pairs: Annotated[int, Field(ge=1, le=1000)] = default_of(SelfCollision, "pairs")
    """How many pairs, the nearest of all, get a row in each tick."""
    fit: Annotated[str, Words(FITS)] = default_of(SelfCollision, "fit")
    """What meshes are replaced by; hulls are closer and slower."""
    include: LinkPairs = default_of(SelfCollision, "include")
    """Pairs of links, by name or pattern, to watch; left out: all that can meet."""
    exclude: LinkPairs = default_of(SelfCollision, "exclude")
    """Pairs of links, by name or pattern, not to watch."""

    def build(self, start: Snapshot, limits: Limits | None) -> BuiltConstraint:
        """Return the constraint."""
        settings = self.model_dump(exclude={"type", "slack"})
        constraint = SelfCollision(start.robot, **settings, limits=limits)
        return BuiltConstraint(lambda *_: constraint, unwatched=constraint.in_contact)
