"""Forces from outside, where MuJoCo takes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from wbc.robot import Robot
from wbc.simulation.push import Push
from wbc.simulation.wrench import AppliedWrench
from wbc.validate import Array

ORIGIN = np.zeros(3)


def apply(
    acting: Sequence[Push | AppliedWrench],
    robot: Robot,
    bodies: Sequence[int],
    data: Any,
    dt: float,
) -> Array:
    """Write what acts, its means over ``dt`` from now, as the forces in MuJoCo's data.

    Returns the sum of the pushes' forces (3,) [N].

    Parameters
    ----------
    bodies:
        MuJoCo's body of each Pinocchio joint.
    """
    data.xfrc_applied[:] = 0.0
    pushed = np.zeros(3)
    for one in acting:
        force, moment = np.split(one.mean(float(data.time), dt), 2)
        frame, point = (one.body, one.point) if isinstance(one, Push) else (one.frame, ORIGIN)
        here = robot.frame(frame)
        body = bodies[int(here.parentJoint)]
        local = np.array(here.placement.rotation) @ point
        local += here.placement.translation
        arm = data.xpos[body] + data.xmat[body].reshape(3, 3) @ local - data.xipos[body]
        data.xfrc_applied[body, :3] += force
        data.xfrc_applied[body, 3:] += moment + np.cross(arm, force)
        pushed += force * isinstance(one, Push)
    return pushed
