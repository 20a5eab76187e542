"""The base of all constraints of a problem file; each kind is a file in ``kinds``."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from wbc.constraints import Constraint, Contact, Limits
from wbc.problem.mistakes import Misplaced, Mistakes
from wbc.problem.section import Positive, Section
from wbc.robot import Snapshot


@dataclass(frozen=True, eq=False)
class BuiltConstraint:
    """A constraint that can be made for any contacts, and moved to any time."""

    # Returns the constraint for contacts that begin at a snapshot; None if there is none.
    during: Callable[[Snapshot, Sequence[Contact]], Constraint | None]
    # Moves obstacles to their poses at a time [s].
    move_to: Callable[[float], None] | None = None
    # Pairs of bodies that are not watched because they touch by design, with the reason.
    unwatched: Mapping[str, str] = field(default_factory=dict)


class ConstraintSpec(Section):
    """What all constraints have in common.

    A kind of constraint is a subclass with a ``type`` of its own and :meth:`build`.
    """

    type: str
    slack: Positive | None = None
    """Weight of the squared slack [1/(m/s)^2] of a constraint that may give way; left out: hard.
    The search of method global knows those that are hard."""

    @property
    def moves(self) -> bool:
        """Whether it changes while the robot is at rest."""
        return False

    @abstractmethod
    def build(self, start: Snapshot, limits: Limits | None) -> BuiltConstraint:
        """Return the constraint, for a robot that starts at ``start``.

        Raises WbcError: an unknown name, or numbers that do not fit.
        """

    def not_in_search(self) -> Iterator[Misplaced]:
        """Yield the keys that a search over postures does not support."""
        return iter(())


@dataclass(frozen=True, eq=False)
class Surroundings:
    """All constraints of a problem, for any contacts and any time."""

    constraints: Mapping[str, BuiltConstraint]  # by name
    slack: Mapping[str, float]  # weights of those that may give way, by name

    def constraints_at(self, snapshot: Snapshot, contacts: Sequence[Contact]) -> list[Constraint]:
        """Return the constraints while ``contacts`` are held, from ``snapshot`` on.

        Raises InvalidInputError: a margin that leaves nothing of a support polygon.
        """
        found = list[Constraint]()
        for name, built in self.constraints.items():
            constraint = built.during(snapshot, contacts)
            if constraint is not None:
                constraint.name = name
                found.append(constraint)
        return found

    def unwatched_pairs(self) -> dict[str, dict[str, str]]:
        """Return the pairs of bodies that constraints do not watch, by the constraint's name."""
        return {
            name: dict(built.unwatched)
            for name, built in self.constraints.items()
            if built.unwatched
        }

    def move_to(self, time: float) -> None:
        """Move obstacles to their poses at ``time`` [s]."""
        for built in self.constraints.values():
            if built.move_to is not None:
                built.move_to(time)


def surroundings(
    specs: Mapping[str, ConstraintSpec], start: Snapshot, limits: Limits | None, mistakes: Mistakes
) -> Surroundings:
    """Return the constraints of a problem; mistakes are noted at their places."""
    made = dict[str, BuiltConstraint]()
    for name, spec in specs.items():
        with mistakes.at("constraints", name):
            made[name] = spec.build(start, limits)
    return Surroundings(
        made, {name: spec.slack for name, spec in specs.items() if spec.slack is not None}
    )
