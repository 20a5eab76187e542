"""Bounds on torques by the motors' effort limits, and limits of joints that these can keep."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from wbc.constraints.limits import TORQUE_SHARE, Limits
from wbc.robot import Robot, Snapshot
from wbc.robot.limits import BASE_NV
from wbc.robot.model import check_robot
from wbc.robot.postures import STANDING
from wbc.tasks.task import Task
from wbc.validate import Array, finite_number, read_only

# What is held twice, by its part of the stiffest row; joints that contacts hold fast still have
# a braking distance [rad/s^2 or m/s^2].
HELD, LEAST = 1e-9, 0.1
MOST = 64  # sets of contacts that are remembered


def limits_within(limits: Limits | None, torques: Array) -> Limits | None:
    """Return limits that the torques can keep; what is none is refused by the controller.

    Joints without a motor brake by those of others, through their loops.
    """
    if not isinstance(limits, Limits):
        return limits
    return limits.within_torques(_without_motors(limits.robot, torques, np.inf))


class StanceBraking:
    """How hard joints can brake while what is held stays where it is.

    By half of a joint's own torque in the standing posture, as the limits' default accelerations,
    which bound them; but a leg that stands carries the robot, not its foot: the ankles of a G1
    brake by 39 and 4 rad/s^2 there, in pitch and roll, by 300 in the air. At least, though, by what
    the ground does that pushes with the robot's weight: g by the distance of the CoM, 15 rad/s^2 on
    a G1. By 4 the roll of a walking one was held from 0.2 of its 0.26 rad off the limit on: pushed
    sideways, it fell. Accelerations that were given to the limits stay.

    Parameters
    ----------
    torques:
        (nv - 6,) largest torques [N m or N].
    """

    def __init__(self, robot: Robot, torques: Array) -> None:
        self._robot, self._torques = robot, _without_motors(robot, torques, np.inf)
        # By what is held: feet come and go, and a change of contacts must be quick.
        self._able: dict[bytes, Array] = {}

    def decelerations(self, limits: Limits | None, held: Sequence[Task]) -> Array:
        """Return how hard joints (nv - 6,) can brake [rad/s^2 or m/s^2], within the limits."""
        if limits is None:
            return read_only(np.zeros(self._torques.size))
        if not held or not limits.by_default:
            return limits.acceleration
        J = np.concatenate([contact.residual(self._standing).jacobian for contact in held])
        able = self._able.get(key := J.tobytes())
        if able is None:
            if len(self._able) == MOST:
                self._able.clear()
            able = self._able[key] = self._able_against(J)
        return read_only(np.maximum(np.minimum(able, limits.acceleration), LEAST))

    @cached_property
    def _standing(self) -> Snapshot:
        return self._robot.snapshot(self._robot.postures[STANDING])

    @cached_property
    def _freely(self) -> tuple[Array, Array]:
        """Accelerations by forces where nothing is held, and what the ground does at most."""
        standing, robot = self._standing, self._robot
        joints = np.array([standing.position(name) for name in robot.joint_names])
        away = np.linalg.norm(joints - standing.com, axis=1)
        # A base that is bolted rests in any case, and may be without mass of its own.
        moves = slice(BASE_NV if robot.fixed_base else 0, None)
        freely = np.zeros((robot.nv, robot.nv))
        freely[moves, moves] = np.linalg.inv(standing.mass_matrix[moves, moves])
        return freely, robot.gravity / np.maximum(away, HELD)

    def _able_against(self, J: Array) -> Array:
        """Return what joints are able to, before limits, while rows J (k, nv) of contacts rest."""
        freely, by_ground = self._freely
        moved = J @ freely
        yielding = np.diagonal(freely - moved.T @ np.linalg.pinv(moved @ J.T, HELD, True) @ moved)
        able = np.maximum(TORQUE_SHARE * yielding[BASE_NV:], 0.0)
        able = np.multiply(self._torques, able, out=np.full(able.size, LEAST), where=able > 0.0)
        return np.maximum(able, by_ground)


def effort_bounds(robot: Robot, factor: float | None) -> Array:
    """Return the largest torques (nv - 6,): infinite without a bound, 0 without a motor."""
    check_robot("controller", robot)
    most = np.full(robot.nv - 6, np.inf)
    if factor is not None:
        most = finite_number("controller, torque_limits", factor, above=0.0) * robot.limits.effort
        _say_unbounded(robot)
    return _without_motors(robot, most, 0.0)


def _say_unbounded(robot: Robot) -> None:
    without = [name for name in robot.limits.without_effort if name not in robot.unactuated]
    if without:
        logging.getLogger(__name__).warning(
            "controller: %s has no effort limit for %s; torques are not bounded there: give"
            " Robot.load(..., effort={%r: N m}), or torque_limits=None to mean it",
            robot.name,
            ", ".join(without),
            without[0],
        )


def _without_motors(robot: Robot, torques: Array, value: float) -> Array:
    """Return torques (nv - 6,) with ``value`` where a joint has no motor."""
    found = torques.copy()
    found[[robot.joint_index(name) - BASE_NV for name in robot.unactuated]] = value
    return read_only(found)
