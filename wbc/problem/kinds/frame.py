"""Frames of the robot: position, orientation, both, or the direction of an axis."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from wbc.problem.section import Forms, Name, Point, Section, Weight, default_of
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
from wbc.tasks import AxisTask, OrientationTask, PoseTask, PositionTask
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
        settings = self.settings(self.axes)
        task = PositionTask(start.robot, self.frame, goal, axes=self.axes, name=name, **settings)

        def current(now: Snapshot) -> Array:
            return now.position(self.frame)

        return TargetedTask(task, fixed_goal(goal), current, VECTORS, task.set_target, self.ramp)


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
        task = OrientationTask(start.robot, self.frame, goal, name=name, **self.settings(TURNS))

        def current(now: Snapshot) -> Array:
            return now.rotation(self.frame)

        return TargetedTask(
            task, fixed_goal(goal), current, ROTATIONS, orientation_setter(task), self.ramp
        )


class PlacementTarget(Section):
    """Position and orientation of a frame."""

    position: PointTarget = "start"
    """Target position of its origin [m], world axes."""
    orientation: RotationTarget = "start"
    """Target orientation."""


class PoseSpec(FrameSpec):
    """Position and orientation of a frame at once."""

    control: Literal["pose"]
    target: Annotated[PlacementTarget | Start, Forms("{position: ..., orientation: ...}, or start")]
    """Target position and orientation."""

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        start.robot.frame_id(self.frame)
        wanted = PlacementTarget() if isinstance(self.target, str) else self.target
        position = point(wanted.position, start.position(self.frame))
        orientation = rotation(wanted.orientation, start.rotation(self.frame))
        settings = self.settings(AXES + TURNS)
        task = PoseTask(start.robot, self.frame, position, orientation, name=name, **settings)

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
        settings = self.settings(AXES)
        task = AxisTask(start.robot, self.frame, way, axis=self.axis, name=name, **settings)

        def current(now: Snapshot) -> Array:
            return now.rotation(self.frame) @ task.axis

        goal = fixed_goal(task.target)
        return TargetedTask(task, goal, current, DIRECTIONS, axis_setter(task), self.ramp)
