"""Torque bounds from effort limits, and joint decelerations that these torques can produce."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from wbc.constraints.limits import TORQUE_SHARE, Limits
from wbc.robot import Robot, Snapshot
from wbc.robot.drives import motors_without_effort
from wbc.robot.limits import BASE_NV
from wbc.robot.model import check_robot
from wbc.robot.postures import STANDING
from wbc.tasks.task import Task
from wbc.validate import Array, finite_number, read_only

# Relative tolerance for redundant contact rows; least deceleration [rad/s^2 or m/s^2] of joints
# that contacts lock, so that they have a braking distance.
PINV_TOLERANCE, LEAST_DECELERATION = 1e-9, 0.1
LEAST_INERTIA = 1e-12  # kg m^2 or kg: in place of none
MOST_CACHED = 64  # sets of contacts


def limits_within(limits: Limits | None, torques: Array) -> Limits | None:
    """Return limits that the torques can keep; anything but Limits is returned as it is.

    Joints without a motor are braked by others, through their loops.
    """
    if not isinstance(limits, Limits):
        return limits
    return limits.within_torques(_without_motors(limits.robot, torques, np.inf))


class StanceBraking:
    """Joint decelerations that motors can produce while contacts do not move.

    Half of a joint's own torque in the standing posture, as in the limits' default accelerations,
    which are an upper bound; but a standing leg carries the robot, not its foot: the ankles of a G1
    brake by 39 and 4 rad/s^2 then, in pitch and roll, by 300 in the air. At least, though, what the
    ground's reaction to the robot's weight does: g by the distance of the CoM, 15 rad/s^2 on a G1.
    At 4 the roll of a walking G1 was bounded from 0.2 of its 0.26 rad before the limit: pushed
    sideways, it fell. Accelerations that were given to the limits are used as they are.

    ``torques``: (nv - 6,) largest torques [N m or N].
    """

    def __init__(self, robot: Robot, torques: Array) -> None:
        self._robot, self._torques = robot, _without_motors(robot, torques, np.inf)
        # By contact Jacobian: a change of contacts must be quick.
        self._cache: dict[bytes, Array] = {}

    def decelerations(self, limits: Limits | None, held: Sequence[Task]) -> Array:
        """Return the joints' decelerations (nv - 6,) [rad/s^2 or m/s^2], within the limits."""
        if limits is None:
            return read_only(np.zeros(self._torques.size))
        if not held or not limits.by_default:
            return limits.acceleration
        J = np.concatenate([contact.residual(self._standing).jacobian for contact in held])
        able = self._cache.get(key := J.tobytes())
        if able is None:
            if len(self._cache) == MOST_CACHED:
                self._cache.clear()
            able = self._cache[key] = self._decelerations_with(J)
        return read_only(np.maximum(np.minimum(able, limits.acceleration), LEAST_DECELERATION))

    @cached_property
    def _standing(self) -> Snapshot:
        return self._robot.snapshot(self._robot.postures[STANDING])

    @cached_property
    def _free_accelerations(self) -> tuple[Array, Array]:
        """Inverse mass matrix (nv, nv) without contacts, and the ground's share (nv - 6,)."""
        standing, robot = self._standing, self._robot
        places = [standing.position(name) for name in robot.joint_names]
        joints = np.array(places).reshape(-1, 3)
        away = np.linalg.norm(joints - standing.com, axis=1)
        # A bolted base does not move, and may be without mass.
        moves = slice(BASE_NV if robot.fixed_base else 0, None)
        freely = np.zeros((robot.nv, robot.nv))
        M = standing.mass_matrix[moves, moves]
        try:
            freely[moves, moves] = np.linalg.inv(M)
        except np.linalg.LinAlgError:  # something turns without moving a mass, such as a root's
            freely[moves, moves] = np.linalg.inv(M + LEAST_INERTIA * np.eye(len(M)))
        return freely, robot.gravity / np.maximum(away, PINV_TOLERANCE)

    def _decelerations_with(self, J: Array) -> Array:
        """Return decelerations (nv - 6,), before limits, with contact rows J (k, nv) at rest."""
        freely, by_ground = self._free_accelerations
        moved = J @ freely
        yielding = np.diagonal(
            freely - moved.T @ np.linalg.pinv(moved @ J.T, PINV_TOLERANCE, True) @ moved
        )
        able = np.maximum(TORQUE_SHARE * yielding[BASE_NV:], 0.0)
        able = np.multiply(
            self._torques, able, out=np.full(able.size, LEAST_DECELERATION), where=able > 0.0
        )
        return np.maximum(able, by_ground)


def effort_bounds(robot: Robot, factor: float | None) -> Array:
    """Return the largest torques (nv - 6,): infinite without a bound, 0 without a motor."""
    check_robot("controller", robot)
    if factor is not None:
        _warn_unbounded(robot)
    return _without_motors(robot, scaled_effort(robot, factor), 0.0)


def scaled_effort(robot: Robot, factor: float | None) -> Array:
    """Return the joints' effort limits (nv - 6,) times a factor; infinite if that is None."""
    if factor is None:
        return np.full(robot.nv - 6, np.inf)
    return finite_number("controller, torque_limits", factor, above=0.0) * robot.limits.effort


def _warn_unbounded(robot: Robot) -> None:
    without = motors_without_effort(robot.limits, robot.motorless)
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
