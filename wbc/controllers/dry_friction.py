"""Torques that make up for the dry friction of joints, which no row of a tick knows of."""

from __future__ import annotations

import numpy as np

from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.series import turning_joints
from wbc.validate import Array

# Friction acts against where a joint is going: its velocity so long from now [s], of which a part
# of the friction is made up for while it is slower than SLOW [rad/s], [m/s]. By the sign of what is
# measured a small humanoid's feet, of 1e-4 kg m^2 and no rotor, chatter until it falls; by 0.03 s
# and 0.5 rad/s a G1 of 8 N m did with noise and delay. With these, walks of three robots stand, and
# a squat that friction stops altogether is followed.
AHEAD = 0.2
SLOW, SLOW_SLIDE = 2.0, 0.2


class DryFriction:
    """Of a robot's motors: those that have none themselves are not helped."""

    def __init__(self, robot: Robot) -> None:
        self._force = np.array(robot.friction)
        self._force[[robot.joint_index(name) - BASE_NV for name in robot.motorless]] = 0.0
        self._slow = np.where(turning_joints(robot), SLOW, SLOW_SLIDE)

    def torques(self, velocity: Array, acceleration: Array) -> Array:
        """Return what makes up for it (nv - 6,) [N m or N], of joints that move so (nv - 6,)."""
        return self._force * np.tanh((velocity + AHEAD * acceleration) / self._slow)
