"""The wrench of one contact."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from wbc.problem.section import Distinct, ListOf, Name, NonEmpty, Number, Weight, Words, default_of
from wbc.problem.targets import entries
from wbc.problem.task_spec import ForceTaskSpec
from wbc.robot import Snapshot
from wbc.run.ramps import TargetedTask, unmeasured
from wbc.tasks import ContactForceTask
from wbc.tasks.force_task import WRENCH


class ContactForceSpec(ForceTaskSpec):
    """The force and moment that the ground gives a contact; of the torque level.

    In a phase in which the frame is no contact, the task rests.
    """

    type: Literal["contact_force"]
    frame: Name
    """Frame of a contact."""
    components: Annotated[NonEmpty[Annotated[str, Words(WRENCH)]], Distinct] = default_of(
        ContactForceTask, "components"
    )
    """Which of fx fy fz mx my mz, world axes, at the frame's origin."""
    target: Annotated[ListOf[Number], Field(min_length=1, max_length=6)] = default_of(
        ContactForceTask, "target"
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
        goal = entries(self.target, self.components, WRENCH)
        settings = self.settings(self.components)
        task = ContactForceTask(
            start.robot, self.frame, goal, components=self.components, name=name, **settings
        )
        return unmeasured(task, goal)
