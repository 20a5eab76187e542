"""Joints, and the base, kept slow."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from wbc.problem.section import Name, NonNegative, default_of
from wbc.problem.task_spec import MotionTaskSpec
from wbc.robot import Snapshot
from wbc.run.ramps import TargetedTask, untargeted
from wbc.tasks import DampingTask


class DampingSpec(MotionTaskSpec):
    """Rest: velocities as low as the other tasks leave them."""

    type: Literal["damping"]
    target: Literal["rest"] = "rest"
    """What is wanted: rest."""
    joints: dict[Name, NonNegative] = Field(default_factory=dict)
    """Factors on the weight by joint name or pattern ("*_knee*"); 0 leaves a joint out."""
    base: bool = default_of(DampingTask, "base")
    """Whether the base's velocity counts too."""
    kd: NonNegative | None = None
    """At the torque level: velocities decay as exp(-kd t) [1/s]; left out: 20."""
    weight: NonNegative = 1.0
    """Weight of the task [1/(rad/s)] or [1/(m/s)]."""

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        settings = self.settings()
        task = DampingTask(start.robot, joints=self.joints, base=self.base, name=name, **settings)
        return untargeted(task)
