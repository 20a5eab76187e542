"""Frames of the robot: position, orientation, both, an axis, and two frames to each other."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Literal

import numpy as np

from wbc.problem.section import (
    Distinct,
    Forms,
    Name,
    NonEmpty,
    NonNegative,
    Point,
    Section,
    Weight,
    Words,
    default_of,
)
from wbc.problem.targets import (
    Axes,
    FromMotion,
    PointTarget,
    RotationTarget,
    Start,
    TurnTarget,
    point,
    rotation,
)
from wbc.problem.task_spec import ErrorTaskSpec
from wbc.robot import Snapshot
from wbc.run.ramps import (
    DIRECTIONS,
    PLACEMENTS,
    ROTATIONS,
    VECTORS,
    TargetedTask,
    axis_setter,
    fixed_goal,
    orientation_setter,
    placement,
    pose_setter,
)
from wbc.tasks import (
    AxisTask,
    DistanceTask,
    OrientationTask,
    PoseTask,
    PositionTask,
    RelativePoseTask,
)
from wbc.tasks.frame import TURNS
from wbc.tasks.point import AXES
from wbc.validate import Array


class FrameSpec(ErrorTaskSpec):
    """Keys of all tasks of a frame."""

    type: Literal["frame"]
    frame: Name
    """A link, joint or other frame of the robot."""
    weight: Weight = 1.0
    """Weight of the task, one number or one per row [1/(m/s)] or [1/(rad/s)]."""

    @property
    def moved_frame(self) -> str | None:
        """The frame."""
        return self.frame


class PositionSpec(FrameSpec):
    """The position of a frame's origin."""

    control: Literal["position"]
    axes: Axes = default_of(PositionTask, "axes")
    """Controlled world axes."""
    target: PointTarget
    """Target position [m], world axes."""

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        start.robot.frame_id(self.frame)
        goal = point(self.target, start.position(self.frame))
        task = PositionTask(start.robot, target=goal, name=name, **self.settings(self.axes))
        here = partial(Snapshot.position, frame=self.frame)
        return TargetedTask(task, fixed_goal(goal), here, VECTORS, task.set_target, self.ramp)


class OrientationSpec(FrameSpec):
    """The orientation of a frame."""

    control: Literal["orientation"]
    target: TurnTarget
    """Target orientation, or {motion: ...} to follow a reference motion."""

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        start.robot.frame_id(self.frame)
        here = start.rotation(self.frame)
        goal = here if isinstance(self.target, FromMotion) else rotation(self.target, here)
        task = OrientationTask(start.robot, target=goal, name=name, **self.settings(TURNS))
        current, set_target = partial(Snapshot.rotation, frame=self.frame), orientation_setter(task)
        return TargetedTask(task, fixed_goal(goal), current, ROTATIONS, set_target, self.ramp)


class PlacementTarget(Section):
    """Position and orientation of a frame."""

    position: PointTarget = "start"
    """Target position of its origin [m], world axes."""
    orientation: RotationTarget = "start"
    """Target orientation."""


PoseTarget = Annotated[
    PlacementTarget | Start, Forms("{position: ..., orientation: ...}, or start")
]


class PoseSpec(FrameSpec):
    """Position and orientation of a frame at once."""

    control: Literal["pose"]
    target: PoseTarget
    """Target position and orientation."""

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        start.robot.frame_id(self.frame)
        wanted = PlacementTarget() if isinstance(self.target, str) else self.target
        position = point(wanted.position, start.position(self.frame))
        orientation = rotation(wanted.orientation, start.rotation(self.frame))
        place = {"position": position, "rotation": orientation, **self.settings(AXES + TURNS)}
        task = PoseTask(start.robot, name=name, **place)

        def current(now: Snapshot) -> Array:
            return placement(now.position(self.frame), now.rotation(self.frame))

        goal = fixed_goal(placement(position, orientation))
        return TargetedTask(task, goal, current, PLACEMENTS, pose_setter(task), self.ramp)


class AxisSpec(FrameSpec):
    """The direction of one axis of a frame; rotation about that axis is free."""

    control: Literal["axis"]
    axis: Point = tuple(float(entry) for entry in default_of(AxisTask, "axis"))
    """The axis, in the frame's own axes."""
    target: Annotated[Point | Start, Forms("a direction [x, y, z], or start")]
    """Target direction, world axes, of any length."""

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        start.robot.frame_id(self.frame)
        way = point(self.target, start.rotation(self.frame) @ np.array(self.axis))
        task = AxisTask(start.robot, target=way, name=name, **self.settings(AXES))

        def current(now: Snapshot) -> Array:
            return now.rotation(self.frame) @ task.axis

        goal = fixed_goal(task.target)
        return TargetedTask(task, goal, current, DIRECTIONS, axis_setter(task), self.ramp)


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
    target: PoseTarget = "start"
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
        place = {"position": position, "rotation": turned, **self.settings(self.components)}
        task = RelativePoseTask(start.robot, name=name, **place)
        goal = fixed_goal(placement(position, turned))
        return TargetedTask(task, goal, self._current, PLACEMENTS, pose_setter(task), self.ramp)

    def _current(self, now: Snapshot) -> Array:
        Ra = now.rotation(self.relative_to)
        arm = now.position(self.frame) - now.position(self.relative_to)
        return placement(np.asarray(Ra.T @ arm), Ra.T @ now.rotation(self.frame))


class DistanceSpec(ErrorTaskSpec):
    """Distance between the origins of two frames."""

    type: Literal["distance"]
    frame: Name
    """A link, joint or other frame of the robot."""
    other: Name
    """The frame from which it is measured."""
    target: NonNegative
    """Target distance [m]."""
    weight: NonNegative = 1.0
    """Weight of the task [1/(m/s)]."""

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        task = DistanceTask(start.robot, target=self.target, name=name, **self.settings())

        def current(now: Snapshot) -> Array:
            return task.residual(now).error + task.target

        def set_target(value: Array, rate: Array, acceleration: Array) -> None:
            task.set_target(float(value[0]), float(rate[0]), float(acceleration[0]))

        goal = fixed_goal(np.array([self.target]))
        return TargetedTask(task, goal, current, VECTORS, set_target, self.ramp)
