"""The centre of pressure."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, Strict

from wbc.problem.mistakes import Misplaced
from wbc.problem.section import Name, Number, Weight, default_of
from wbc.problem.task_spec import ForceTaskSpec
from wbc.robot import Snapshot
from wbc.run.ramps import VECTORS, TargetedTask, fixed_goal
from wbc.tasks import CopTask


class CopSpec(ForceTaskSpec):
    """The centre of pressure, of one contact or of all; of the torque level.

    In a phase in which the frame is no contact, the task rests.
    """

    type: Literal["cop"]
    frame: Name | None = default_of(CopTask, "frame")
    """Frame of a contact; left out: the CoP of all contacts."""
    target: Annotated[tuple[Number, ...], Strict(False), Field(min_length=2, max_length=3)]
    """Wanted point [m]. Of all contacts [x, y] or [x, y, z] in the world; of one contact [x, y] in
    the axes of its frame, from its origin."""
    weight: Weight = default_of(CopTask, "weight")
    """Weight of the task, one number or one per row (mx, my), on the moment about the wanted point
    times dt over the robot's mass [1/(m^2/s)]."""

    @property
    def contact_frames(self) -> tuple[str, ...]:
        """The frame, if it is one."""
        return () if self.frame is None else (self.frame,)

    def check_change(self, before: Self) -> None:
        """Refuse a point with a height after one without, and the other way round."""
        if len(self.target) != len(before.target):
            raise Misplaced(
                f"needs {len(before.target)} entries as in the task itself, got {len(self.target)}",
                "target",
            )

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        if self.frame is not None and len(self.target) != 2:
            raise Misplaced(
                f"needs 2 entries, in the plane of {self.frame}, got {len(self.target)}", "target"
            )
        goal, settings = np.array(self.target, dtype=float), self.settings(("mx", "my"))
        task = CopTask(start.robot, goal, frame=self.frame, name=name, **settings)
        return TargetedTask(
            task,
            fixed_goal(goal),
            lambda _: goal,
            VECTORS,
            lambda value, *_: task.set_target(value),
        )
