"""Robots that stand, and what tests ask of them."""

from __future__ import annotations

import numpy as np

import wbc
from wbc.robot import Robot, Snapshot


def standing(robot: Robot) -> Snapshot:
    return robot.snapshot(robot.posture("standing"), np.zeros(robot.nv))


def stack(here: Snapshot) -> list[wbc.Task]:
    """CoM, trunk and posture with no gains given at all."""
    robot = here.robot
    return [
        wbc.ComTask(robot, here.com),
        wbc.OrientationTask(robot, "base", here.rotation("base")),
        wbc.PostureTask(robot, here.q),
    ]
