"""What a walking robot's tasks give each other when not all of them can be had."""

from collections.abc import Callable

import numpy as np
import pytest

from wbc.constraints import Limits
from wbc.constraints.friction import FrictionCone
from wbc.gait.swing import FootPose
from wbc.gait.whole_body import WalkingWeights, WholeBody
from wbc.robot import Robot

Load = Callable[[str], Robot]


@pytest.mark.parametrize("name", ["g1", "icub"])
def test_a_foot_that_hurries_leaves_the_pressure_where_it_is_wanted(
    robot_named: Load, name: str
) -> None:
    """At 60 m/s^2; the CoP is that of the planned wrench."""
    robot = robot_named(name)
    start = robot.snapshot(robot.posture("standing"))
    left, right = (robot.feet[side] for side in ("left", "right"))
    height = float(start.com[2])
    body = WholeBody(
        start, 0.0, height, WalkingWeights(), FrictionCone(), limits=Limits(robot), dt=0.002
    )
    body.hold(start, ["left"], 0.001)
    half = left.polygon.max(axis=0)
    wanted = start.position(left.frame) + (0.5 * half[0], 0.0, 0.0)
    hurried = np.array((60.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    pose = start.position(right.frame), start.rotation(right.frame)
    body.swing("right", FootPose(*pose, np.zeros(6), hurried))
    body.lead(start, wanted, np.array((height, 0.0, 0.0)), 0.0, 0.0)
    for _ in range(3):  # the right foot gives up its load within one
        tick = body.controller.step(start)
    force, moment = np.split(tick.forces[left.frame], 2)
    pressure = np.array((-moment[1], moment[0])) / force[2]  # from the frame, on the ground
    off = np.abs(pressure - (0.5 * half[0], 0.0))
    assert (off < 0.3 * half).all()
    foot = start.jacobian(right.frame)[0] @ tick.acceleration
    assert foot > 0.9 * 60.0
