"""What is hard and was not kept after all: which, by how much, when and where."""

from __future__ import annotations

import numpy as np

from wbc.constraints import SelfCollision
from wbc.gait.legs import SIDES
from wbc.retargeting.ground_forces import stretches
from wbc.retargeting.mending import too_near
from wbc.retargeting.result import slides
from wbc.retargeting.smoothing import able_accelerations
from wbc.retargeting.targets import Targets
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.series import state_series
from wbc.tracking.unbalanced import Unbalanced
from wbc.validate import Array


def broken(
    robot: Robot, collision: SelfCollision | None, targets: Targets, q: Array, v: Array,
    acceleration: Array,
) -> tuple[Unbalanced, ...]:  # fmt: skip
    """Return what is hard and not kept by a motion (n, nq), (n, nv)."""
    limits, time = robot.limits, targets.time
    parts = [
        ("sole slides", slides(robot, targets, q), [f"{side} foot" for side in SIDES]),
        ("joint limit passed", limits.past(limits.joint_positions(q)), robot.joint_names),
        (
            "speed above the limit",
            np.abs(v[:, BASE_NV:]) / limits.velocity - 1.0,
            robot.joint_names,
        ),
        (
            "acceleration above the motor's",
            np.abs(acceleration[:, BASE_NV:]) / able_accelerations(robot) - 1.0,
            robot.joint_names,
        ),
    ]
    found = list[Unbalanced]()
    for what, by, names in parts:
        for name, column in zip(names, by.T, strict=True):
            found += stretches(what, column, time, np.full(len(time), name))
    if collision is not None:
        frames, pairs, clearance, _ = too_near(robot, collision, q, state_series(robot, q), 0.0)
        for pair in np.unique(pairs[clearance < 0.0]).tolist():
            by = np.zeros(len(q))
            by[frames[pairs == pair]] = -clearance[pairs == pair]
            name = collision.model.labels[pair]
            found += stretches("margin broken", by, time, np.full(len(time), name))
    return tuple(found)
