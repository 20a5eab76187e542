"""Distance between two frames."""

from __future__ import annotations

from typing import Literal

import numpy as np

from wbc.problem.section import Name, NonNegative
from wbc.problem.task_spec import ErrorTaskSpec
from wbc.robot import Snapshot
from wbc.run.ramps import VECTORS, TargetedTask, fixed_goal
from wbc.tasks import DistanceTask
from wbc.validate import Array


class DistanceSpec(ErrorTaskSpec):
    """Distance between the origins of two frames."""

    type: Literal["distance"]
    frame: Name
    """A link, joint or other frame of the robot."""
    other: Name
    """The frame from which it is measured."""
    target: NonNegative
    """Target distance [m]."""
    weight: NonNegative = 1.0
    """Weight of the task [1/(m/s)]."""

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        robot = start.robot
        ends = self.frame, self.other
        task = DistanceTask(robot, *ends, self.target, name=name, **self.settings())

        def current(now: Snapshot) -> Array:
            return task.residual(now).error + task.target

        def set_target(value: Array, rate: Array, acceleration: Array) -> None:
            task.set_target(float(value[0]), float(rate[0]), float(acceleration[0]))

        goal = fixed_goal(np.array([self.target]))
        return TargetedTask(task, goal, current, VECTORS, set_target, self.ramp)
