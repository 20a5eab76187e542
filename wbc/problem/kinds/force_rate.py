"""Contact forces without jumps."""

from __future__ import annotations

from typing import Annotated, Literal

from wbc.problem.section import Distinct, Names, NonNegative, default_of
from wbc.problem.task_spec import ForceTaskSpec
from wbc.robot import Snapshot
from wbc.run.ramps import TargetedTask, untargeted
from wbc.tasks import ForceRateTask


class ForceRateSpec(ForceTaskSpec):
    """Wrenches of contacts as the last tick decided them; of the torque level.

    It is nothing in the first tick of a run or phase. As to frames that are no contacts in a phase,
    it rests.
    """

    type: Literal["force_rate"]
    target: Literal["last"] = "last"
    """What is wanted: the wrenches of the last tick."""
    frames: Annotated[Names, Distinct] | None = default_of(ForceRateTask, "frames")
    """Frames of contacts; left out: the soles of the robot's feet."""
    weight: NonNegative = default_of(ForceRateTask, "weight")
    """Weight of the task, on the change per tick times dt over the robot's mass [1/(m/s)]."""

    @property
    def contact_frames(self) -> tuple[str, ...]:
        """The frames, if the file names any."""
        return self.frames or ()

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        task = ForceRateTask(start.robot, self.frames, name=name, **self.settings())
        return untargeted(task)
