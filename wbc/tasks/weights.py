"""A task's weight: checked when it is set, by joint, and not lost by mistake."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.validate import Array, by_name, finite_number, finite_vector, read_only


def checked_weight(task: str, weight: Any, size: int) -> Array:
    """Return factors (size,) on a task's rows, of one for all or one each."""
    what = f"{task}, weight"
    one = not isinstance(weight, Iterable) or getattr(weight, "ndim", 1) == 0
    vector = finite_vector(what, [weight] * size if one else weight, size)
    if (vector < 0.0).any():
        raise InvalidInputError(f"{what}: must not be negative, got {weight!r}")
    return read_only(vector)


def joint_factors(robot: Robot, joints: Mapping[str, float] | None, task: str) -> Array:
    """Return factors (nv,) on a task's weight, by joint name or pattern; 1 where none is given."""
    factors = np.ones(robot.nv)
    given = by_name(f"task {task!r}, joints", {} if joints is None else joints)
    for pattern, factor in given.items():
        value = finite_number(f"task {task!r}, weight of joint {pattern!r}", factor, least=0.0)
        factors[list(robot.joint_indices(pattern))] = value
    return factors


def warn_if_lost(task: str, before: Array, weight: Array) -> None:
    """Say that a task that did something does nothing from now on."""
    if before.any() and not weight.any():
        logging.getLogger(__name__).warning(
            "%s: its weight is set to 0, so that it does nothing until it has one again;"
            " switch_off() does that without this warning",
            task,
        )
