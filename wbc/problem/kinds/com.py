"""The centre of mass."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, ClassVar, Literal

import numpy as np

from wbc.controllers import Controller
from wbc.errors import UnknownNameError
from wbc.gait.capture_gain import CaptureGain
from wbc.laws import AccelerationLaw
from wbc.problem.mistakes import Misplaced
from wbc.problem.section import (
    Forms,
    Name,
    Names,
    Number,
    Point,
    Positive,
    Section,
    Weight,
    default_of,
)
from wbc.problem.targets import Axes, Followed, FromMotion, FromPlan, Offset, Start, point
from wbc.problem.task_spec import ErrorTaskSpec
from wbc.robot import Robot, Snapshot
from wbc.robot.feet import NO_FEET
from wbc.run.ramps import VECTORS, TargetedTask, UpdateLaw
from wbc.tasks import ComTask
from wbc.validate import Array

DOUBLE = ("left", "right")


class Over(Section):
    """A target of the CoM above the robot's feet."""

    over: Annotated[Name | Names, Forms("a foot, double, all, or a list of feet")]
    """A foot, double for left and right together, all, or a list of feet: the centre of its sole,
    or of those of several, at the time when the target is set."""
    height: Number | None = None
    """Height above the ground [m]; unchanged if left out."""


ComTarget = Annotated[
    Point | Offset | Over | FromPlan | FromMotion | Start,
    Forms(
        "[x, y, z] in metres, {offset: [x, y, z]}, {over: foot}, {plan: file}, {motion: file}, or"
        " start"
    ),
]


class CapturePointLaw(Section):
    """Gains that control the capture point to the target."""

    type: Literal["capture_point"]
    gain: Positive = default_of(AccelerationLaw.capture_point, "gain")
    """Distance of the centroidal moment pivot beyond the capture point, relative to its error: kp =
    gain omega^2 and kd = (1 + gain) omega, omega^2 = gravity / height."""
    spin: Positive | None = None
    """Gain at the edges of the soles, where angular momentum has to help; at least gain, which then
    applies where the CoP alone suffices. The height is that of the CoM above the soles at each
    tick. Left out: gain, wherever the capture point is."""


class ComSpec(ErrorTaskSpec):
    """The centre of mass."""

    of_plan: ClassVar[tuple[str, ...]] = ("com", "com_velocity", "com_acceleration")

    type: Literal["com"]
    axes: Axes = default_of(ComTask, "axes")
    """Controlled world axes."""
    target: ComTarget
    """Target position [m], world axes; {over: left} is above a foot, {plan: ...} follows a plan,
    {motion: ...} a reference motion."""
    weight: Weight = 1.0
    """Weight of the task, one number or one per axis [1/(m/s)]."""
    law: (
        Annotated[
            Literal["capture_point"] | CapturePointLaw,
            Forms("capture_point, or {type: capture_point, gain: ...}"),
        ]
        | None
    ) = None
    """capture_point: kp and kd are computed from the CoM's initial height so that the capture point
    goes to the target; of the torque level, for the axes x and y."""

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""

        def goal(now: Snapshot, before: Array) -> Array:
            if isinstance(self.target, Followed):
                return before
            if not isinstance(self.target, Over):
                return point(self.target, start.com)
            soles = [now.robot.feet[foot].frame for foot in self.feet_below(now.robot)]
            place = np.mean([now.position(sole) for sole in soles], axis=0)
            place[2] = before[2] if self.target.height is None else self.target.height
            return place

        settings = {**self.settings(self.axes), **self._gains(start)}
        task = ComTask(start.robot, goal(start, start.com), name=name, **settings)
        return TargetedTask(
            task, goal, lambda now: now.com, VECTORS, task.set_target, self.ramp,
            attendant=self._attendant(task),
        )  # fmt: skip

    def _gains(self, start: Snapshot) -> dict[str, float | None]:
        """Return kp and kd of the law, if one is given."""
        if self.law is None:
            return {}
        for key in ("kp", "kd"):
            if key in self.model_fields_set:
                raise Misplaced(f"give {key} or law, not both", key)
        if "z" in self.axes:
            raise Misplaced("a capture point is on the ground; give axes: [x, y]", "law")
        given = CapturePointLaw(type="capture_point") if isinstance(self.law, str) else self.law
        if given.spin is not None and given.spin < given.gain:
            raise Misplaced(f"is below gain, {given.gain:g}", "law", "spin")
        gravity = start.robot.gravity
        law = AccelerationLaw.capture_point(float(start.com[2]), given.gain, gravity)
        return {"kp": law.kp, "kd": law.kd}

    def _attendant(self, task: ComTask) -> Callable[[Controller], UpdateLaw] | None:
        """Return the settings of a law for the capture point, if it is one."""
        law = self.law
        if not isinstance(law, CapturePointLaw) or law.spin is None:
            return None
        gains = {"gain": law.gain, "spin": law.spin}
        return lambda controller: CaptureGain(controller, task, **gains).prepare

    def feet_below(self, robot: Robot) -> tuple[str, ...]:
        """Return the feet above which the target lies, all of which exist."""
        if not isinstance(self.target, Over):
            return ()
        several = {"double": DOUBLE, "all": tuple(robot.feet)}
        over = self.target.over
        below: list[str] = []
        for one in (over,) if isinstance(over, str) else over:
            feet = several.get(one, (one,))
            if not feet or not set(feet) <= set(robot.feet):
                words = (word for word, feet in several.items() if set(feet) <= set(robot.feet))
                choices = [*robot.feet, *words] if robot.feet else []
                remedy = "" if robot.feet else NO_FEET
                raise UnknownNameError(f"foot of {robot.name}", one, choices, remedy)
            below += feet
        return tuple(below)
