"""Rows that Python works out in each tick, in a QP that the core sets up.

Of tasks that do not describe their rows (one's own, those about forces, inertia in a frame's axes):
their residual, law or expression is asked as in a tick in Python, some microseconds each, and all
else is the core's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.controllers.native_parts import Part
from wbc.laws import Residual, Rows
from wbc.native.rows import Kind, NativeRows
from wbc.tasks.force_task import ForceTask
from wbc.tasks.task import Task


class GivenRows(NamedTuple):
    """The rows of a task at one snapshot.

    Attributes
    ----------
    name:
        The task's.
    residual:
        Of a task about motion; None: of one about forces, whose error the tick decides.
    """

    name: str
    rows: Rows
    residual: Residual | None


class GivenPart(Part):
    """One task whose rows are worked out in Python, and where they go.

    Parameters
    ----------
    n, nv:
        How many unknowns there are, and how many of them are the velocity's.
    unit:
        Newtons per unit of a force unknown.
    """

    def __init__(self, task: Task, torque: bool, n: int, nv: int, unit: float) -> None:
        super().__init__(task, None, held=False, torque=torque)
        k = len(task.rows)
        numbers = np.zeros((k, n)), np.zeros(k), np.zeros(k), np.zeros(nv)
        none = np.zeros(k)
        self.rows = (NativeRows(Kind.GIVEN, None, tuple(range(k)), none, none, numbers),)
        self._shape = k, n
        self._decided = unit if isinstance(task, ForceTask) else 0.0

    def write(self, dt: float) -> bool:
        """Take note of a change; False if the rows can no longer be given."""
        self.changes, self.assigned = self.task._changes, self.task._assigned
        return may_be_given(self.task, self.torque)

    def fill(self, given: GivenRows) -> bool:
        """Write the rows of a tick; False if they are none that the core knows."""
        rows, residual = given.rows, given.residual
        (k, n), (place,) = self._shape, self._places
        matrix, target, told, damping = place.rest[2:]
        width = rows.matrix.shape[-1]
        shapes = rows.matrix.shape, rows.target.shape, rows.weight.shape
        if rows.curvature is not None or shapes != ((k, width), (k,), (k,)) or width > n:
            return False
        matrix = matrix.reshape(k, n)
        matrix[:, :width] = rows.matrix
        matrix[:, width:] = 0.0
        target[:] = rows.target
        place.weight[:] = rows.weight
        damping[:] = rows.damping
        told[:] = 0.0 if residual is None else residual.error
        place.header[0] = self._decided
        return True


def may_be_given(task: Task, torque: bool) -> bool:
    """Whether a task's rows are a plain cost: its target is not reduced, nor its cost curved."""
    if torque:
        return True
    return task.law.singular_threshold == 0.0 and not getattr(task, "second_order", False)
