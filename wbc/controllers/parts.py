"""Checks on the parts that a controller is made of, and on what they return."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from wbc.constraints.limits import Limits
from wbc.constraints.rows import Constraint
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.laws import Residual
from wbc.robot import Robot
from wbc.tasks.task import Task


def check_parts(
    robot: Robot,
    tasks: Sequence[Task],
    contacts: Sequence[Task],
    limits: Limits | None,
    constraints: Sequence[Constraint],
) -> None:
    """Refuse what is no part of a controller, parts of another robot, and names given twice.

    Raises
    ------
    InvalidInputError
        The message says which part, and what it should be.
    """
    if not isinstance(robot, Robot):
        raise InvalidInputError(
            f"controller: expected a robot as Robot.load() returns it, got {robot!r}"
        )
    for kind, given, wanted in (
        ("tasks", tasks, Task),
        ("contacts", contacts, Task),
        ("constraints", constraints, Constraint),
    ):
        _check_list(kind, given, wanted)
    if limits is not None and not isinstance(limits, Limits):
        raise InvalidInputError(f"controller, limits: expected Limits or None, got {limits!r}")
    if not tasks:
        raise InvalidInputError("controller: no task given; there is nothing to do")
    parts: list[Task | Constraint | Limits] = [*tasks, *contacts, *constraints]
    for part in [*parts, *([limits] if limits else [])]:
        if part.robot is not robot:
            raise InvalidInputError(f"controller: {part!r} was made for another robot object")
    for kind, names in (
        ("task", [task.name for task in tasks]),
        ("contact", [contact.name for contact in contacts]),
    ):
        for name in names:
            if names.count(name) > 1:
                raise InvalidInputError(f"controller: two {kind}s are called {name!r}")


def check_residual(task: Task, residual: Residual, nv: int) -> Residual:
    """Return what a task returned as its residual, if it is one.

    Raises
    ------
    InvalidInputError
        Not a residual, or arrays of other shapes than the task's rows and the robot's nv say.
    """
    k = len(task.rows)
    try:
        shapes = residual.error.shape, residual.jacobian.shape, residual.bias.shape
    except AttributeError as error:
        raise InvalidInputError(
            f"task {task.name!r}: residual() must return a Residual of arrays (error, jacobian, "
            f"bias), got {type(residual).__name__}"
        ) from error
    if shapes != ((k,), (k, nv), (k,)):
        raise InvalidInputError(
            f"task {task.name!r}, which has {k} rows: residual() must return error ({k},), "
            f"jacobian ({k}, {nv}) and bias ({k},), got {shapes[0]}, {shapes[1]} and {shapes[2]}"
        )
    return residual


def one_of(kind: str, value: str, choices: Sequence[str]) -> str:
    """Return ``value`` if it is one of the choices, else raise UnknownNameError."""
    if value not in choices:
        raise UnknownNameError(kind, value, choices)
    return value


def _check_list(kind: str, given: Any, wanted: type) -> None:
    what = "Task objects" if wanted is Task else "Constraint objects"
    if isinstance(given, wanted):
        raise InvalidInputError(f"controller, {kind}: expected a list, got one; write [...]")
    hint = '; wbc.support(snapshot, "double") makes contacts' if kind == "contacts" else ""
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise InvalidInputError(
            f"controller, {kind}: expected a list of {what}, got {given!r}{hint}"
        )
    for one in given:
        if not isinstance(one, wanted):
            raise InvalidInputError(
                f"controller, {kind}: expected {what}, but the list has {one!r}{hint}"
            )
