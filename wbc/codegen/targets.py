"""The rows of a controller as the core numbers them, and the targets of tasks in C."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wbc.codegen.c_text import identifier
from wbc.controllers import Controller
from wbc.native.rows import Kind, NativeRows
from wbc.tasks import InertiaTask
from wbc.tasks.task import Task
from wbc.validate import Array

# What a part of a task with several is called.
_WORDS = {Kind.POINT: "position", Kind.ORIENTATION: "orientation"}


class TargetPart(NamedTuple):
    """A block of rows: one of a task's, or a contact's."""

    name: str  # in C
    task: Task
    number: int
    kind: Kind


class PartTargets(NamedTuple):
    """What a part should be, with rate and acceleration: sizes as in source/controller.h."""

    target: Array
    rate: Array
    acceleration: Array


def task_parts(controller: Controller) -> list[TargetPart]:
    """Return the parts of all tasks, as the core numbers them; contacts come behind them."""
    return _parts(controller.tasks, "WBC_TASK")


def contact_parts(controller: Controller) -> list[TargetPart]:
    """Return the parts of contacts, of gears and of a bolted base."""
    return _parts(controller.plan.held.contacts, "WBC_CONTACT")


def _parts(tasks: Sequence[Task], prefix: str) -> list[TargetPart]:
    found, taken = [], set[str]()
    for task in tasks:
        rows = task.native() or ()
        for number, one in enumerate(rows):
            words = [prefix, task.name, *([_WORDS[one.kind]] if len(rows) > 1 else [])]
            name = identifier("_".join(words), taken)
            found.append(TargetPart(name, task, number, Kind(one.kind)))
    return found


def targets_of(part: TargetPart) -> PartTargets | None:
    """Return the present targets of a task's part; None if it has none."""
    task = part.task
    rows = (task.native() or ())[part.number]
    match part.kind:
        case Kind.POINT | Kind.POINTING:
            return PartTargets(rows.numbers[0], *_rates(rows, 3))
        case Kind.ORIENTATION:
            target, rate, acceleration = rows.numbers
            return PartTargets(target, rate, acceleration)
        case Kind.INERTIA if isinstance(task, InertiaTask):
            return PartTargets(task.target, task.target_rate, task.target_acceleration)
        case Kind.JOINTS:
            size = task.robot.nv - 6
            return PartTargets(_scattered(rows.numbers[0], rows, size), *_rates(rows, size))
        case Kind.MOMENTUM:
            return PartTargets(*_rates(rows, 6), np.zeros(0))
    return None


def _rates(rows: NativeRows, size: int) -> tuple[Array, Array]:
    """Return rate and acceleration of the target, with zeros where no row asks."""
    return _scattered(-rows.bias, rows, size), _scattered(-rows.drift, rows, size)


def _scattered(values: ArrayLike, rows: NativeRows, size: int) -> Array:
    whole: Array = np.zeros(size)
    whole[list(rows.entries)] = values
    return whole
