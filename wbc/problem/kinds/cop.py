"""The centre of pressure."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field

from wbc.problem.mistakes import Misplaced
from wbc.problem.section import Forms, ListOf, Name, Number, Weight, default_of
from wbc.problem.targets import Followed, MotionForm, PlanForm, form_with_plan
from wbc.problem.task_spec import ForceTaskSpec
from wbc.robot import Snapshot
from wbc.run.ramps import TargetedTask, unmeasured
from wbc.tasks import CopTask
from wbc.validate import Array

CopTarget = Annotated[
    Annotated[ListOf[Number], Field(min_length=2, max_length=3)] | PlanForm | MotionForm,
    Forms(
        pick=form_with_plan,
        expected="[x, y] or [x, y, z] in metres, {plan: file}, or {motion: file}",
    ),
]


class CopSpec(ForceTaskSpec):
    """The centre of pressure, of one contact or of all; of the torque level.

    In a phase in which the frame is no contact, the task rests.
    """

    of_plan: ClassVar[tuple[str, ...]] = ("cop",)

    type: Literal["cop"]
    frame: Name | None = default_of(CopTask, "frame")
    """Frame of a contact; left out: the CoP of all contacts."""
    target: CopTarget
    """Wanted point [m]. Of all contacts [x, y] or [x, y, z] in the world, or {plan: ...}, as a plan
    says, or {motion: ...}, as a motion does; of one contact [x, y] in the axes of its frame, from
    its origin."""
    weight: Weight = default_of(CopTask, "weight")
    """Weight of the task, one number or one per row (mx, my), on the moment about the wanted point
    times dt over the robot's mass [1/(m^2/s)]."""

    @property
    def contact_frames(self) -> tuple[str, ...]:
        """The frame, if it is one."""
        return () if self.frame is None else (self.frame,)

    def check_change(self, before: Self) -> None:
        """Refuse a point with a height after one without, and the other way round."""
        if isinstance(self.target, Followed) or isinstance(before.target, Followed):
            return
        if len(self.target) != len(before.target):
            raise Misplaced(
                f"needs {len(before.target)} entries as in the task itself, got {len(self.target)}",
                "target",
            )

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        goal, settings = self._goal(start), self.settings(("mx", "my"))
        task = CopTask(start.robot, goal, frame=self.frame, name=name, **settings)
        return unmeasured(task, goal)

    def _goal(self, start: Snapshot) -> Array:
        """Return the wanted point, (2,) or (3,) [m]; below the CoM until a plan begins."""
        if isinstance(self.target, Followed):
            if self.frame is not None:
                raise Misplaced("a plan has the CoP of all contacts; leave this out", "frame")
            return np.append(start.com[:2], 0.0)
        if self.frame is not None and len(self.target) != 2:
            raise Misplaced(
                f"needs 2 entries, in the plane of {self.frame}, got {len(self.target)}", "target"
            )
        return np.array(self.target, dtype=float)
