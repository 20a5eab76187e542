"""Tasks of the torque level: contact forces, their CoP and distribution, and joint torques."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field

from wbc.problem.mistakes import Misplaced
from wbc.problem.section import (
    Distinct,
    Forms,
    ListOf,
    Name,
    Names,
    NonEmpty,
    NonNegative,
    Number,
    Weight,
    Words,
    default_of,
)
from wbc.problem.targets import Followed, FromMotion, FromPlan, entries
from wbc.problem.task_spec import ForceTaskSpec
from wbc.robot import Snapshot
from wbc.run.ramps import TargetedTask, force_target, without_target
from wbc.tasks import ContactForceTask, CopTask, ForceRateTask, LoadShareTask, TorqueTask
from wbc.tasks.force_task import WRENCH
from wbc.validate import Array

CopTarget = Annotated[
    Annotated[ListOf[Number], Field(min_length=2, max_length=3)] | FromPlan | FromMotion,
    Forms("[x, y] or [x, y, z] in metres, {plan: file}, or {motion: file}"),
]
Torques = Annotated[
    Number | NonEmpty[Number] | dict[Name, Number],
    Forms("a number, {joint: torque}, or a list with one for each joint"),
]


class ContactForceSpec(ForceTaskSpec):
    """The force and moment of the ground on a contact; of the torque level.

    While the frame is no contact, the task is off.
    """

    type: Literal["contact_force"]
    frame: Name
    """Frame of a contact."""
    components: Annotated[NonEmpty[Annotated[str, Words(WRENCH)]], Distinct] = default_of(
        ContactForceTask, "components"
    )
    """Components among fx fy fz mx my mz, world axes, at the frame's origin."""
    target: Annotated[ListOf[Number], Field(min_length=1, max_length=6)] = default_of(
        ContactForceTask, "target"
    )
    """Target force [N], then moment [N m]: six numbers, or one for each component."""
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
        task = ContactForceTask(start.robot, target=goal, name=name, **settings)
        return force_target(task, goal)


class CopSpec(ForceTaskSpec):
    """The centre of pressure, of one contact or of all; of the torque level.

    While the frame is no contact, the task is off.
    """

    of_plan: ClassVar[tuple[str, ...]] = ("cop",)

    type: Literal["cop"]
    frame: Name | None = default_of(CopTask, "frame")
    """Frame of a contact; left out: the CoP of all contacts."""
    target: CopTarget
    """Target point [m]. For all contacts [x, y] or [x, y, z] in the world, {plan: ...} to follow a
    plan, or {motion: ...} a reference motion; for one contact [x, y] in its frame."""
    weight: Weight = default_of(CopTask, "weight")
    """Weight of the task, one number or one per row (mx, my), on the moment about the target point
    times dt over the robot's mass [1/(m^2/s)]."""

    @property
    def contact_frames(self) -> tuple[str, ...]:
        """The frame, if it is one."""
        return () if self.frame is None else (self.frame,)

    def check_change(self, before: Self) -> None:
        """Refuse a point with a height after one without, and vice versa."""
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
        task = CopTask(start.robot, goal, name=name, **settings)
        return force_target(task, goal)

    def _goal(self, start: Snapshot) -> Array:
        """Return the target point, (2,) or (3,) [m]; below the CoM until a plan begins."""
        if isinstance(self.target, Followed):
            if self.frame is not None:
                raise Misplaced("a plan has the CoP of all contacts; leave this out", "frame")
            return np.append(start.com[:2], 0.0)
        if self.frame is not None and len(self.target) != 2:
            raise Misplaced(
                f"needs 2 entries, in the plane of {self.frame}, got {len(self.target)}", "target"
            )
        return np.array(self.target, dtype=float)


class ForceRateSpec(ForceTaskSpec):
    """Changes of contact wrenches from tick to tick; of the torque level.

    It is off in the first tick of a run or phase, and for frames that are no contacts.
    """

    type: Literal["force_rate"]
    target: Literal["last"] = "last"
    """The target: the wrenches of the last tick."""
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
        return without_target(ForceRateTask(start.robot, name=name, **self.settings()))


class LoadShareSpec(ForceTaskSpec):
    """Distribution of the total vertical force over contacts; of the torque level.

    If some of them are no contacts in a phase, the shares of the others stay in proportion; with
    less than two the task is off.
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
        """The contacts, in an order that does not depend on that in the file."""
        return tuple(sorted(self.target))

    def check_change(self, before: Self) -> None:
        """Refuse a change of the frames."""
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
        goal = task.target / task.target.sum()  # normalised, so that it changes smoothly
        return force_target(task, goal)


class TorqueTaskSpec(ForceTaskSpec):
    """Joint torques, near zero or given values; of the torque level."""

    type: Literal["torque"]
    target: Torques = default_of(TorqueTask, "target")
    """Target torques [N m or N]: one for all, by joint name or pattern (all others 0), or a list of
    those of all joints of the robot."""
    joints: Annotated[Names, Distinct] = default_of(TorqueTask, "joints")
    """Names or patterns ("*_knee*") of the joints of the task."""
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
        task = TorqueTask(robot, self.target, name=name, **self.settings())
        return force_target(task, task.target)
