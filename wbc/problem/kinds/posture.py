"""The joints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from wbc.flight.rounds import Rounds
from wbc.problem.mistakes import Misplaced
from wbc.problem.section import Forms, Name, NonNegative, Number
from wbc.problem.targets import FromMotion, LoopTarget
from wbc.problem.task_spec import ErrorTaskSpec
from wbc.robot import Robot, Snapshot
from wbc.run.ramps import TargetedTask, configuration_space, fixed_goal
from wbc.tasks import PostureTask
from wbc.validate import Array

# "start" is a word like the names of postures: as a form of its own it would match twice in the
# JSON Schema.
PostureTarget = Annotated[
    dict[Name, Number] | LoopTarget | FromMotion | Name,
    Forms("the name of a posture, {joint: value}, {loop: ...}, {motion: file}, or start"),
]


class PostureSpec(ErrorTaskSpec):
    """The joints' positions; with a low weight, for the motions that other tasks leave free."""

    of_plan: ClassVar[tuple[str, ...]] = ("q", "v", "acceleration")

    type: Literal["posture"]
    target: PostureTarget = "start"
    """A posture of the robot by name, or joint values [rad or m] by name or pattern; joints that
    are not named keep their initial values. Or {loop: ...}, a closed path from the start of the
    run, or {motion: ...} to follow a reference motion."""
    joints: dict[Name, NonNegative] = Field(default_factory=dict)
    """Factors on the weight by joint name or pattern ("*_knee*"); 0 leaves a joint out."""
    weight: NonNegative = 1.0
    """Weight of the task [1/(rad/s)]."""

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        robot, course = start.robot, None
        if isinstance(self.target, LoopTarget):
            if self.ramp is not None:
                raise Misplaced("a loop says itself how its target moves; leave this out", "ramp")
            course = Rounds.of(robot, start.q, **dict(self.target))
            goal = start.q
        elif isinstance(self.target, FromMotion):
            goal = start.q
        elif isinstance(self.target, str):
            goal = start.q if self.target == "start" else robot.posture(self.target)
        else:
            goal = with_joints(robot, start.q, self.target)
        task = PostureTask(robot, goal, name=name, **self.settings())
        space = configuration_space(robot)
        return TargetedTask(
            task, fixed_goal(goal), lambda now: now.q, space, task.set_target, self.ramp, course
        )


def with_joints(robot: Robot, q: Array, joints: Mapping[str, float]) -> Array:
    """Return ``q`` with joints, by name or pattern, at the given values [rad or m].

    Mimic joints and their drivers go together.
    """
    named = robot.posture("neutral", joints)
    meant = {index for pattern in joints for index in robot.joint_indices(pattern)}
    for joint, coupling in robot.couplings.items():
        gear = {*robot.joint_indices(joint), *robot.joint_indices(coupling.driver)}
        meant |= gear if gear & meant else set()
    chosen = sorted(meant)
    step = np.zeros(robot.nv)
    step[chosen] = robot.difference(q, named)[chosen]
    return robot.integrate(q, step, 1.0)
