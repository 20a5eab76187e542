"""Forces from outside, where MuJoCo takes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from wbc.robot import Robot
from wbc.validate import Array

ORIGIN = np.zeros(3)


def add_wrench(
    data: Any,
    robot: Robot,
    bodies: Sequence[int],
    frame: str,
    force: Array,
    moment: Array,
    point: Array = ORIGIN,
) -> None:
    """Add a force (3,) [N] and a moment (3,) [N m], world axes, to those in MuJoCo's data.

    Parameters
    ----------
    bodies:
        MuJoCo's body of each Pinocchio joint.
    point:
        Where the force acts (3,) [m], in the frame's axes from its origin.
    """
    here = robot.frame(frame)
    body = bodies[int(here.parentJoint)]
    local = np.array(here.placement.rotation) @ point + here.placement.translation
    arm = data.xpos[body] + data.xmat[body].reshape(3, 3) @ local - data.xipos[body]
    data.xfrc_applied[body, :3] += force
    data.xfrc_applied[body, 3:] += moment + np.cross(arm, force)
