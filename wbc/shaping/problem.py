"""The global shaping problem, checked once, and its cost at a posture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from wbc.constraints import ComSupport, Constraint, Contact, Limits
from wbc.constraints.margin import Margin
from wbc.errors import InvalidInputError
from wbc.kinds import check_kind
from wbc.robot import Robot, Snapshot
from wbc.robot.model import check_robot
from wbc.robot.tree import refuse_loops
from wbc.tasks import Task
from wbc.validate import Array, list_of

DT = 0.005  # s


@dataclass(frozen=True, eq=False)
class ShapingProblem:
    """The parts of a global shaping problem, as for a kinematic controller."""

    robot: Robot
    tasks: tuple[Task, ...]
    contacts: tuple[Contact, ...]
    limits: Limits
    constraints: tuple[Margin, ...]
    dt: float = DT  # of the controller that moves there [s]

    @property
    def anchor(self) -> Contact | None:
        """The first contact that holds all of a frame: the base then follows from the joints."""
        return next((contact for contact in self.contacts if len(contact.rows) == 6), None)

    @property
    def supports(self) -> tuple[ComSupport, ...]:
        """The constraints that keep the CoM over a polygon."""
        return tuple(one for one in self.constraints if isinstance(one, ComSupport))


def posture_cost(tasks: Sequence[Task], snapshot: Snapshot, dt: float = DT) -> float:
    """Return the sum over tasks of gain * 1/2 |weight * error|^2.

    A tick asks for 1/2 |weight * (J v + gain/dt * error)|^2, whose gradient at v = 0 is 1/dt times
    that of this sum: the controller rests exactly where this cost cannot be lowered by a small
    motion. With one task the gain is a common factor and says nothing.
    """
    total = 0.0
    for task in tasks:
        weighted = task.weight * task.residual(snapshot).error
        total += 0.5 * effective_gain(task, dt) * float(weighted @ weighted)
    return total


def effective_gain(task: Task, dt: float) -> float:
    """Return the gain that a squared error counts by: of a tick, or 1 where its weight is all."""
    return task.law.fraction(dt) * task.law.factor(dt) ** 2


def posture_errors(tasks: Sequence[Task], snapshot: Snapshot) -> Mapping[str, Array]:
    """Return what each task reports as its error, by name."""
    return {task.name: task.deviation(snapshot, task.residual(snapshot)) for task in tasks}


def check_parts(
    robot: Robot,
    tasks: Sequence[Task],
    contacts: Sequence[Contact],
    limits: Limits,
    constraints: Sequence[Constraint],
) -> tuple[Margin, ...]:
    """Refuse parts of another robot, names given twice, several levels, and no task at all.

    Returns
    -------
    The constraints.
    """
    what = "global shaping"
    check_robot(what, robot)
    refuse_loops(what, robot)
    list_of(f"{what}, contacts", contacts, Contact, "Contact.hold(snapshot, frame)")
    list_of(f"{what}, constraints", constraints, Constraint, "SelfCollision(robot)")  # type: ignore[type-abstract]
    check_kind(f"{what}, limits", limits, Limits, "Limits(robot)")
    if not list_of(f"{what}, tasks", tasks, Task, "ComTask(robot, target)"):  # type: ignore[type-abstract]
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
    margins = tuple(one for one in constraints if isinstance(one, Margin))
    for one in (other for other in constraints if not isinstance(other, Margin)):
        raise InvalidInputError(
            f"global shaping: constraint {one.name!r} is a {type(one).__name__}, which has no"
            " margin to measure; leave it to the controller that moves there"
        )
    for part in (*tasks, *contacts):
        _refuse_inherited(part, "residual", "symbolic_error")
    for margin in margins:
        _refuse_inherited(margin, "distances", "symbolic_rows")
    return margins


def _refuse_inherited(part: Task | Margin, numbers: str, symbols: str) -> None:
    """Refuse a kind of one's own that defines ``numbers`` anew and inherits ``symbols``.

    The search would be for what it is derived from.
    """
    for owner in (part, *type(part).__mro__):
        if symbols in vars(owner) or getattr(owner, "_tested", True):
            return
        if numbers in vars(owner):
            raise InvalidInputError(
                f"global shaping: {part.name!r} is a {type(part).__name__}, which defines"
                f" {numbers}() anew and inherits {symbols}(), which the search minimises or keeps:"
                f" define {symbols}() too, or leave it to the controller that moves there"
            )
