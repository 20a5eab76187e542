"""What is to be solved: tasks, contacts, limits and constraints, checked once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from wbc.constraints import ComSupport, Constraint, Contact, Limits, PointContact
from wbc.constraints.clearance import Clearance
from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.tasks import Task


@dataclass(frozen=True, eq=False)
class ShapingProblem:
    """The parts of a global shaping problem.

    Attributes
    ----------
    robot, tasks, contacts, limits:
        As for :class:`~wbc.controllers.kinematic.KinematicController`.
    constraints:
        What the answer must respect besides.
    """

    robot: Robot
    tasks: tuple[Task, ...]
    contacts: tuple[Contact, ...]
    limits: Limits
    constraints: tuple[Clearance, ...]

    @property
    def anchor(self) -> Contact | None:
        """The first contact that holds a frame entirely: the base then follows from the joints."""
        return next((c for c in self.contacts if not isinstance(c, PointContact)), None)

    @property
    def supports(self) -> tuple[ComSupport, ...]:
        """The constraints that keep the CoM over a polygon."""
        return tuple(one for one in self.constraints if isinstance(one, ComSupport))


def check_parts(
    robot: Robot,
    tasks: Sequence[Task],
    contacts: Sequence[Contact],
    limits: Limits,
    constraints: Sequence[Constraint],
) -> tuple[Clearance, ...]:
    """Refuse parts of another robot, names given twice, several levels, and no task at all.

    Returns
    -------
    The constraints.

    Raises
    ------
    InvalidInputError
        One of these, or a constraint of an unknown kind; the message names the part.
    """
    if not tasks:
        raise InvalidInputError("global shaping: no task given; there is nothing to optimise")
    parts: list[Task | Contact | Limits | Constraint] = [*tasks, *contacts, limits, *constraints]
    for part in parts:
        if part.robot is not robot:
            raise InvalidInputError(f"global shaping: {part!r} was made for another robot object")
    names = [task.name for task in tasks]
    for name in names:
        if names.count(name) > 1:
            raise InvalidInputError(f"global shaping: two tasks are called {name!r}")
    levels = sorted({task.priority for task in tasks})
    if len(levels) > 1:
        raise InvalidInputError(
            f"global shaping: tasks have priorities {levels}; it weighs tasks against each other"
            " within one level. Give all tasks the same priority"
        )
    return tuple(_known(constraint) for constraint in constraints)


def _known(constraint: Constraint) -> Clearance:
    if not isinstance(constraint, Clearance):
        raise InvalidInputError(
            f"global shaping: constraint {constraint.name!r} is a {type(constraint).__name__},"
            " which has no margin to measure; leave it to the controller that moves there"
        )
    return constraint
