"""Names and units of the numbers that a task reports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wbc.robot import Robot
from wbc.spatial import COMPONENTS, DIAGONAL, vech_inverse
from wbc.tasks import (
    AxisTask,
    ComTask,
    InertiaTask,
    MomentumTask,
    OrientationTask,
    PoseTask,
    PositionTask,
    PostureTask,
    PrincipalInertiaTask,
    Task,
)
from wbc.tasks.frame import TURNS
from wbc.tasks.inertia import TRACE
from wbc.tasks.momentum import LINEAR
from wbc.validate import Array

MOMENTS = ("smallest", "middle", "largest")
_INERTIA = "kg m^2"


def reported_rows(task: Task) -> tuple[str, ...]:
    """Return what the entries of a task's reported error are called."""
    if isinstance(task, PrincipalInertiaTask):
        return MOMENTS
    if isinstance(task, InertiaTask):
        doubled = {"xy", "xz", "yz"}
        return tuple(f"sqrt(2) {row}" if row in doubled else row for row in task.rows)
    return task.rows


def units(task: Task, per_mass: bool = False) -> tuple[str, ...]:
    """Return the unit of each entry of a task's reported error."""
    if isinstance(task, InertiaTask | PrincipalInertiaTask):
        return ("m^2" if per_mass else _INERTIA,) * len(reported_rows(task))
    if isinstance(task, ComTask | PositionTask):
        return ("m",) * len(task.rows)
    if isinstance(task, OrientationTask | PoseTask):
        return tuple("rad" if row in TURNS else "m" for row in task.rows)
    if isinstance(task, MomentumTask):
        return tuple("kg m/s" if row in LINEAR else "kg m^2/s" for row in task.rows)
    if isinstance(task, PostureTask):
        return tuple(_joint_unit(task.robot, name) for name in task.rows)
    return ("1" if isinstance(task, AxisTask) else "",) * len(task.rows)


def _joint_unit(robot: Robot, name: str) -> str:
    kind = robot.model.joints[robot.model.getJointId(name)].shortname()
    return "m" if kind.startswith("JointModelP") else "rad"


@dataclass(frozen=True, eq=False)
class InertiaReading:
    """What an inertia task controls, in kg m^2 and as plain entries of the matrix.

    Attributes
    ----------
    axes:
        The frame whose axes these are; ``principal`` for principal moments.
    components:
        Names of the entries below.
    start, wanted, reached:
        (k,) at the start, at the end of the target's ramp, and at the end of the run.
    """

    axes: str
    components: tuple[str, ...]
    start: Array
    wanted: Array
    reached: Array


def inertia_reading(
    task: InertiaTask | PrincipalInertiaTask, start: Array, reached: Array
) -> InertiaReading:
    """Return the reading of a task; ``start`` and ``reached`` (6,) are in the task's axes."""
    if isinstance(task, PrincipalInertiaTask):
        moments = [np.linalg.eigvalsh(vech_inverse(s)) for s in (start, reached)]
        return InertiaReading("principal", MOMENTS, moments[0], task.target, moments[1])
    values = (_entries(task.rows, s) for s in (start, task.target, reached))
    return InertiaReading(task.frame, task.rows, *values)


def _entries(rows: tuple[str, ...], s: Array) -> Array:
    if rows == TRACE:
        return np.array([s[DIAGONAL].sum()])
    return s[[COMPONENTS.index(row) for row in rows]]


def by_row(rows: tuple[str, ...], values: Array) -> Mapping[str, float]:
    """Return values by the names of their rows."""
    return dict(zip(rows, (float(value) for value in values), strict=True))
