"""What tasks of one's own return, looked at in every tick; those of this package are tested.

Types, shapes and numbers are looked at before they are used, in a microsecond or two. Integers,
numbers of single precision and lists are converted; what NumPy would have to guess at (imaginary
parts, masks, words, objects, ``np.matrix``, sparse matrices) is refused. What a task raises itself
is raised, with a note that names the task.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from wbc.errors import InvalidInputError, shown
from wbc.laws import Residual
from wbc.robot import Snapshot
from wbc.tasks.task import Task
from wbc.validate import FLOAT, LARGEST, Array, answer_of, finite_number, returned_array

_ARRAY, _hypot = np.ndarray, math.hypot


def is_tested(task: Task, method: str) -> bool:
    """Whether a method is this package's."""
    return task._tested and method not in task.__dict__


def residual_of(task: Task, snapshot: Snapshot) -> Residual:
    """Return the residual of a task.

    Raises InvalidInputError: a task of one's own returns something else, or of other shapes than
    its rows and the robot's nv say; the message names task and field.
    """
    own = task.__dict__
    if task._tested and "residual" not in own:
        return task.residual(snapshot)
    found = answer_of(task, "residual", task.residual, snapshot)
    if type(found) is Residual:
        error, jacobian, bias, curvature, bound = found
        of_rows, of_jacobian = own.get("_shapes") or _shapes(task)
        # Written out: in functions of their own these lines took twice as long.
        if (
            type(error) is type(jacobian) is type(bias) is _ARRAY
            and error.dtype is jacobian.dtype is bias.dtype is FLOAT
            and error.shape == bias.shape == of_rows
            and jacobian.shape == of_jacobian
            and curvature is None
            and type(bound) is float
            and 0.0 <= bound <= LARGEST
            and _hypot(*(error.tolist() + bias.tolist())) <= LARGEST  # NaN is not
            and np.vdot(jacobian, jacobian) <= LARGEST * LARGEST
        ):
            return found
    return _checked(task, found)


def drift_of(task: Task, snapshot: Snapshot) -> Array:
    """Return the drift (k,) of a task; raises as :func:`residual_of` does."""
    if is_tested(task, "drift"):
        return task.drift(snapshot)
    found = answer_of(task, "drift", task.drift, snapshot)
    of_rows, _ = task.__dict__.get("_shapes") or _shapes(task)
    if (
        type(found) is _ARRAY
        and found.dtype is FLOAT
        and found.shape == of_rows
        and _hypot(*found.tolist()) <= LARGEST
    ):
        return found
    return returned_array(f"{task}: drift()", found, of_rows)


def deviation_of(task: Task, snapshot: Snapshot, residual: Residual) -> Array:
    """Return what a task reports as its error; raises as :func:`residual_of` does."""
    if is_tested(task, "deviation"):
        return task.deviation(snapshot, residual)
    found = answer_of(task, "deviation", task.deviation, snapshot, residual)
    return returned_array(f"{task}: deviation()", found, (len(task.reported_rows),))


def check_residual(task: Task, snapshot: Snapshot) -> None:
    """Ask a task again, and look at all that it returns.

    Raises InvalidInputError: as :func:`residual_of` does; also of tasks of this package.
    """
    _checked(task, answer_of(task, "residual", task.residual, snapshot))


def _shapes(task: Task) -> tuple[tuple[int], tuple[int, int]]:
    """Return the shapes of error and Jacobian, and keep them."""
    k = len(task.rows)
    found = task.__dict__["_shapes"] = (k,), (k, task.robot.nv)
    return found


def _checked(task: Task, found: object) -> Residual:
    """Return a residual with all fields checked, and converted where that is plain."""
    k, nv = len(task.rows), task.robot.nv
    what = f"{task}: residual()"
    if not isinstance(found, Residual):
        raise InvalidInputError(
            f"{what} must return Residual with arrays error ({k},), jacobian ({k}, {nv}), bias"
            f" ({k},); got {shown(found)}"
        )
    jacobian = returned_array(f"{what}, jacobian", found.jacobian, (k, nv))
    curvature = found.curvature
    if curvature is not None:
        curvature = returned_array(f"{what}, curvature", curvature, (nv, nv))
    bound = found.curvature_bound
    bound = (
        partial(_evaluated, task, f"{what}, curvature_bound", bound)
        if callable(bound)
        else _bound(f"{what}, curvature_bound", bound, nv)
    )
    return Residual(
        returned_array(f"{what}, error", found.error, (k,)),
        jacobian,
        returned_array(f"{what}, bias", found.bias, (k,)),
        curvature,
        bound,
    )


def _evaluated(task: Task, what: str, bound: Callable[[], float | Array]) -> float | Array:
    return _bound(what, answer_of(task, "curvature_bound", bound), task.robot.nv)


def _bound(what: str, value: Any, nv: int) -> float | Array:
    """Return a number, or one for each entry of v; none negative."""
    if np.ndim(value) == 0:
        return finite_number(what, value, least=0.0)
    bound = returned_array(what, value, (nv,))
    if bound.min() < 0.0:
        raise InvalidInputError(f"{what}: must be at least 0, got {bound.min():g}")
    return bound
