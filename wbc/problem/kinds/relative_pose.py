"""Pose of one frame relative to another."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from wbc.problem.kinds.frame import PlacementTarget
from wbc.problem.section import Distinct, Forms, Name, NonEmpty, Weight, Words, default_of
from wbc.problem.targets import Start, point, rotation
from wbc.problem.task_spec import ErrorTaskSpec
from wbc.robot import Snapshot
from wbc.run.ramps import PLACEMENTS, TargetedTask, fixed_goal, placement, pose_setter
from wbc.tasks import RelativePoseTask
from wbc.tasks.frame import TURNS
from wbc.tasks.point import AXES
from wbc.validate import Array


class RelativePoseSpec(ErrorTaskSpec):
    """Position and orientation of a frame relative to another frame of the robot."""

    type: Literal["relative_pose"]
    frame: Name
    """A link, joint or other frame of the robot."""
    relative_to: Name
    """The reference frame."""
    components: Annotated[NonEmpty[Annotated[str, Words(AXES + TURNS)]], Distinct] = default_of(
        RelativePoseTask, "components"
    )
    """Controlled components among x y z rx ry rz, in axes of ``relative_to``."""
    target: Annotated[
        PlacementTarget | Start, Forms("{position: ..., orientation: ...}, or start")
    ] = "start"
    """Target position [m] and orientation, in axes of ``relative_to``."""
    weight: Weight = 1.0
    """Weight of the task, one number or one per row [1/(m/s)] or [1/(rad/s)]."""

    @property
    def moved_frame(self) -> str | None:
        """The frame."""
        return self.frame

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        for frame in (self.frame, self.relative_to):
            start.robot.frame_id(frame)
        here = self._current(start)
        wanted = PlacementTarget() if isinstance(self.target, str) else self.target
        position = point(wanted.position, here[:, 3])
        turned = rotation(wanted.orientation, here[:, :3])
        task = RelativePoseTask(
            start.robot,
            self.frame,
            self.relative_to,
            position,
            turned,
            components=self.components,
            name=name,
            **self.settings(self.components),
        )

        goal = fixed_goal(placement(position, turned))
        return TargetedTask(task, goal, self._current, PLACEMENTS, pose_setter(task), self.ramp)

    def _current(self, now: Snapshot) -> Array:
        Ra = now.rotation(self.relative_to)
        arm = now.position(self.frame) - now.position(self.relative_to)
        return placement(np.asarray(Ra.T @ arm), Ra.T @ now.rotation(self.frame))
