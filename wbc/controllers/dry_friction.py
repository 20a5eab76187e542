"""Compensation of the joints' dry friction, which the tick's dynamics leave out."""

from __future__ import annotations

import numpy as np

from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.series import revolute_joints
from wbc.validate import Array

# Compensation follows the velocity predicted AHEAD seconds from now, smoothed by tanh below SLOW
# [rad/s], SLOW_SLIDE [m/s]. With the sign of the measured velocity, a small humanoid's feet (1e-4
# kg m^2, no rotor) chatter until it falls; with 0.03 s and 0.5 rad/s a G1 of 8 N m did, with noise
# and delay. With these values three robots walk, and a squat that friction would stop is followed.
AHEAD = 0.2
SLOW, SLOW_SLIDE = 2.0, 0.2


class DryFriction:
    """The dry friction of a robot's joints with motors."""

    def __init__(self, robot: Robot) -> None:
        self._force = np.array(robot.friction)
        self._force[[robot.joint_index(name) - BASE_NV for name in robot.motorless]] = 0.0
        self._slow = np.where(revolute_joints(robot), SLOW, SLOW_SLIDE)

    def torques(self, velocity: Array, acceleration: Array) -> Array:
        """Return the compensating torques (nv - 6,) [N m or N] at this motion (nv - 6,)."""
        return self._force * np.tanh((velocity + AHEAD * acceleration) / self._slow)
