"""Bounds on torques by the motors' effort limits, and limits of joints that these can keep."""

from __future__ import annotations

import logging

import numpy as np

from wbc.constraints.limits import Limits
from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.validate import Array, finite_number, read_only


def limits_within(limits: Limits | None, torques: Array) -> Limits | None:
    """Return limits that the torques can keep; what is none is refused by the controller."""
    return limits.within_torques(torques) if isinstance(limits, Limits) else limits


def effort_bounds(robot: Robot, factor: float | None) -> Array:
    """Return the largest torques (nv - 6,), infinite where there is no bound."""
    if not isinstance(robot, Robot):
        raise InvalidInputError(
            f"controller: expected a robot as Robot.load() returns it, got {robot!r}"
        )
    if factor is None:
        return read_only(np.full(robot.nv - 6, np.inf))
    without = robot.limits.without_effort
    if without:
        logging.getLogger(__name__).warning(
            "controller: %s has no effort limit for %s; torques are not bounded there: give"
            " Robot.load(..., effort={%r: N m}), or torque_limits=None to mean it",
            robot.name,
            ", ".join(without),
            without[0],
        )
    return read_only(
        finite_number("controller, torque_limits", factor, above=0.0) * robot.limits.effort
    )
