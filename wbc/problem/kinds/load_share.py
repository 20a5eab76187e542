"""How contacts share the load."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field

from wbc.problem.mistakes import Misplaced
from wbc.problem.section import Name, NonNegative, Weight, default_of
from wbc.problem.task_spec import ForceTaskSpec
from wbc.robot import Snapshot
from wbc.run.ramps import TargetedTask, unmeasured
from wbc.tasks import LoadShareTask


class LoadShareSpec(ForceTaskSpec):
    """How contacts share the vertical force that they bear together; of the torque level.

    In a phase in which some of them are no contacts, the others share in proportion; with one or
    none left, the task rests.
    """

    type: Literal["load_share"]
    target: Annotated[dict[Name, NonNegative], Field(min_length=2)]
    """Shares by the contacts' frames, in proportion: {left_sole: 2, right_sole: 1}. A phase that
    changes them names the same frames."""
    weight: Weight = default_of(LoadShareTask, "weight")
    """Weight of the task, one number or one per frame in their alphabetical order, on the error
    times dt over the robot's mass [1/(m/s)]."""

    @property
    def contact_frames(self) -> tuple[str, ...]:
        """Those that share, in an order that does not depend on how the file writes them."""
        return tuple(sorted(self.target))

    def check_change(self, before: Self) -> None:
        """Refuse other frames."""
        if self.contact_frames != before.contact_frames:
            raise Misplaced(
                f"needs the frames that the task has: {', '.join(before.contact_frames)}", "target"
            )

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        frames = self.contact_frames
        if not any(self.target.values()):
            raise Misplaced("the shares must not all be 0", "target")
        shares = {frame: self.target[frame] for frame in frames}
        task = LoadShareTask(start.robot, shares, name=name, **self.settings(frames))
        goal = task.target / task.target.sum()  # so that a change is even, whatever the numbers
        return unmeasured(task, goal)
