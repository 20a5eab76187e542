"""The wrench of one contact."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, Strict

from wbc.problem.mistakes import Misplaced
from wbc.problem.section import Distinct, Name, Number, Weight, Words, default_of
from wbc.problem.task_spec import ForceTaskSpec
from wbc.robot import Snapshot
from wbc.run.ramps import VECTORS, TargetedTask, fixed_goal
from wbc.tasks import ContactForceTask
from wbc.tasks.force_task import WRENCH
from wbc.validate import Array


class ContactForceSpec(ForceTaskSpec):
    """The force and moment that the ground gives a contact; of the torque level.

    In a phase in which the frame is no contact, the task rests.
    """

    type: Literal["contact_force"]
    frame: Name
    """Frame of a contact."""
    components: Annotated[
        tuple[Annotated[str, Words(WRENCH)], ...], Strict(False), Field(min_length=1), Distinct
    ] = default_of(ContactForceTask, "components")
    """Which of fx fy fz mx my mz, world axes, at the frame's origin."""
    target: Annotated[tuple[Number, ...], Strict(False), Field(min_length=1, max_length=6)] = (
        default_of(ContactForceTask, "target")
    )
    """Wanted force [N], then moment [N m]: six numbers, or one for each component."""
    weight: Weight = default_of(ContactForceTask, "weight")
    """Weight of the task, one number or one per row, on the error times dt over the robot's mass
    [1/(m/s)]."""

    @property
    def contact_frames(self) -> tuple[str, ...]:
        """The frame."""
        return (self.frame,)

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        goal, settings = self._goal(), self.settings(self.components)
        task = ContactForceTask(
            start.robot, self.frame, goal, components=self.components, name=name, **settings
        )
        return TargetedTask(
            task,
            fixed_goal(goal),
            lambda _: goal,
            VECTORS,
            lambda value, *_: task.set_target(value),
        )

    def _goal(self) -> Array:
        goal, rows = np.zeros(len(WRENCH)), [WRENCH.index(row) for row in self.components]
        if len(self.target) == len(WRENCH):
            return np.array(self.target, dtype=float)
        if len(self.target) != len(rows):
            raise Misplaced(
                f"needs {len(rows)} entries ({', '.join(self.components)}) or all {len(WRENCH)},"
                f" got {len(self.target)}",
                "target",
            )
        goal[rows] = self.target
        return goal
