"""A simulated gantry: straps at shoulders and hips, on a frame with casters.

The straps bear a robot that is lower than its crouch, and keep it upright there. As it rises they
become slack and the frame rolls along; where it comes down again, they catch it.
"""

from __future__ import annotations

import math

import numpy as np

from wbc.gait.swing import turned, yaw_of
from wbc.robot import Robot
from wbc.rotations import rotation_from
from wbc.simulation import Plant
from wbc.validate import Array

SAG = 0.03  # m of the straps under the robot's weight
SLACK_HEIGHT = 0.05  # m over the hanging height at which straps become slack
LEVER = 0.25  # m from the base, of the straps that hold its rotation
BASE_BODY = 1  # MuJoCo's index of the base: the first body after the world
DAMPING = 0.3  # of critical; more is unstable at the light trunk


class Gantry:
    """Pulls at a plant's base; ``height`` is that of the hanging base [m]."""

    def __init__(self, robot: Robot, start: Array) -> None:
        self.height = float(start[2])
        self._stiffness = robot.weight / SAG
        self._damping = 2.0 * DAMPING * math.sqrt(self._stiffness * robot.mass)
        self._anchor: tuple[Array, Array] | None = None  # place and rotation

    def pull(self, plant: Plant, q: Array, v: Array) -> None:
        """Pull in the next step of the physics."""
        tension = 1.0 - (float(q[2]) - self.height) / SLACK_HEIGHT
        wrench = plant.data.xfrc_applied[BASE_BODY]
        if tension <= 0.0:
            if self._anchor is not None:
                wrench[:] = 0.0
            self._anchor = None
            return
        R = rotation_from(q[3:7])
        if self._anchor is None:
            self._anchor = np.array((q[0], q[1], self.height)), turned(yaw_of(R))
        anchor, upright = self._anchor
        E = upright @ R.T
        turn = 0.5 * np.array((E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]))
        tension = min(tension, 1.0)
        force = tension * (self._stiffness * (anchor - q[:3]) - self._damping * (R @ v[:3]))
        force[2] = max(force[2], 0.0)  # straps do not push
        torque = tension * LEVER**2 * (self._stiffness * turn - self._damping * (R @ v[3:6]))
        (ax, ay, az), (fx, fy, fz) = (
            (plant.data.xpos[BASE_BODY] - plant.data.xipos[BASE_BODY]).tolist(),
            force,
        )
        wrench[:3] = force
        wrench[3:] = torque + (ay * fz - az * fy, az * fx - ax * fz, ax * fy - ay * fx)
