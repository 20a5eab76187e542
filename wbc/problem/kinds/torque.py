"""Joint torques."""

from __future__ import annotations

from typing import Annotated, Literal

from wbc.problem.mistakes import Misplaced
from wbc.problem.section import (
    Distinct,
    Forms,
    Name,
    Names,
    NonEmpty,
    NonNegative,
    Number,
    default_of,
)
from wbc.problem.task_spec import ForceTaskSpec
from wbc.robot import Snapshot
from wbc.run.ramps import TargetedTask, unmeasured
from wbc.tasks import TorqueTask

Torques = Annotated[
    Number | NonEmpty[Number] | dict[Name, Number],
    Forms("a number, {joint: torque}, or a list with one for each joint"),
]


class TorqueTaskSpec(ForceTaskSpec):
    """Joint torques: as small as can be, or near given ones; of the torque level."""

    type: Literal["torque"]
    target: Torques = default_of(TorqueTask, "target")
    """Wanted torques [N m or N]: one for all, by joint name or pattern (all others 0), or a list of
    those of all joints of the robot."""
    joints: Annotated[Names, Distinct] = default_of(TorqueTask, "joints")
    """Names or patterns ("*_knee*") of the joints that count."""
    weight: NonNegative = default_of(TorqueTask, "weight")
    """Weight of the task, on the error times dt over the robot's mass [1/(m^2/s)]."""

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        robot, size = start.robot, len(start.robot.joint_names)
        if isinstance(self.target, tuple) and len(self.target) != size:
            raise Misplaced(
                f"needs {size} entries, one for each joint of the robot, got {len(self.target)}",
                "target",
            )
        task = TorqueTask(robot, self.target, joints=self.joints, name=name, **self.settings())
        return unmeasured(task, task.target)
