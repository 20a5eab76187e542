"""What a laboratory hangs a robot in: straps at shoulders and hips, on a frame with casters.

The straps bear what hangs deeper than the robot's crouch, and keep it upright there. As it rises
they become slack and the frame rolls along; where it comes down again, they catch it.
"""

from __future__ import annotations

import math

import numpy as np

from wbc.gait.swing import turned, yaw_of
from wbc.robot import Robot
from wbc.rotations import rotation_from
from wbc.simulation import Plant
from wbc.validate import Array

SAG = 0.03  # m by which the straps give under the robot's weight
SLACK_ABOVE = 0.05  # m over the height at which it hangs
ARM = 0.25  # m from the base at which straps hold its rotation
BODY = 1  # MuJoCo's number of the base: the first body after the world
DAMPING = 0.3  # of critical; more is unstable at the trunk, which is light


class Gantry:
    """Pulls at a plant's base; ``height`` is the base's where it hangs [m]."""

    def __init__(self, robot: Robot, start: Array) -> None:
        self.height = float(start[2])
        self._stiffness = robot.weight / SAG
        self._damping = 2.0 * DAMPING * math.sqrt(self._stiffness * robot.mass)
        self._anchor: tuple[Array, Array] | None = None  # place and rotation

    def pull(self, plant: Plant, q: Array, v: Array) -> None:
        """Pull in the next step of the physics, unless somebody pushes meanwhile."""
        tight = 1.0 - (float(q[2]) - self.height) / SLACK_ABOVE
        wrench = plant.data.xfrc_applied[BODY]
        if tight <= 0.0:
            if self._anchor is not None:
                wrench[:] = 0.0
            self._anchor = None
            return
        R = rotation_from(q[3:7])
        if self._anchor is None:
            self._anchor = np.array((q[0], q[1], self.height)), turned(yaw_of(R))
        place, upright = self._anchor
        off = upright @ R.T
        turn = 0.5 * np.array((off[2, 1] - off[1, 2], off[0, 2] - off[2, 0], off[1, 0] - off[0, 1]))
        tight = min(tight, 1.0)
        force = tight * (self._stiffness * (place - q[:3]) - self._damping * (R @ v[:3]))
        force[2] = max(force[2], 0.0)  # straps do not push
        torque = tight * ARM**2 * (self._stiffness * turn - self._damping * (R @ v[3:6]))
        (ax, ay, az), (fx, fy, fz) = (
            (plant.data.xpos[BODY] - plant.data.xipos[BODY]).tolist(),
            force,
        )
        wrench[:3] = force
        wrench[3:] = torque + (ay * fz - az * fy, az * fx - ax * fz, ax * fy - ay * fx)
