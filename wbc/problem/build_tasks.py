"""From the description of a task to the task, and to the ramp of its target if it has one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, assert_never

import numpy as np
from numpy.typing import ArrayLike

from wbc.problem import targets
from wbc.problem.mistakes import Misplaced
from wbc.problem.ramps import MinimumJerk, MovingTarget
from wbc.problem.target_specs import PlacementTarget
from wbc.problem.task_specs import (
    AxisSpec,
    ComSpec,
    InertiaSpec,
    MomentumSpec,
    OrientationSpec,
    PoseSpec,
    PositionSpec,
    PostureSpec,
    TaskSpec,
)
from wbc.robot import Snapshot
from wbc.spatial import strung
from wbc.tasks import (
    AxisTask,
    ComTask,
    InertiaTask,
    MomentumTask,
    OrientationTask,
    PoseTask,
    PositionTask,
    PostureTask,
    PrincipalInertiaTask,
    Task,
)
from wbc.tasks.frame import TURNS
from wbc.tasks.inertia import ALL, DIAGONAL_COMPONENTS, TRACE
from wbc.tasks.momentum import ANGULAR, LINEAR
from wbc.tasks.point import AXES
from wbc.validate import Array

INERTIA_COMPONENTS = {"all": ALL, "diagonal": DIAGONAL_COMPONENTS, "trace": TRACE}
MOMENTUM_COMPONENTS = {"all": LINEAR + ANGULAR, "linear": LINEAR, "angular": ANGULAR}


class BuiltTask(NamedTuple):
    """A task, and what moves its target if that is not fixed."""

    task: Task
    moving: MovingTarget | None = None


def build_task(name: str, spec: TaskSpec, start: Snapshot) -> BuiltTask:
    """Return the task that ``spec`` describes, for a robot that starts at ``start``.

    Raises
    ------
    WbcError
        An unknown frame or joint, or numbers that do not fit.
    """
    if isinstance(spec, InertiaSpec) and spec.components == "principal":
        return _principal(name, spec, start)
    if isinstance(spec, InertiaSpec):
        return _inertia(name, spec, start)
    if isinstance(spec, ComSpec):
        return _com(name, spec, start)
    if isinstance(spec, PositionSpec):
        return _position(name, spec, start)
    return BuiltTask(_fixed(name, spec, start))


def _com(name: str, spec: ComSpec, start: Snapshot) -> BuiltTask:
    goal = targets.point(spec.target, start.com)
    weight = _weight(spec.weight, spec.axes)
    task = ComTask(start.robot, goal, axes=spec.axes, name=name, weight=weight, **_law(spec))
    return BuiltTask(task, _ramp(spec.ramp, start.com, goal, task.set_target))


def _position(name: str, spec: PositionSpec, start: Snapshot) -> BuiltTask:
    start.robot.frame_id(spec.frame)
    here = start.position(spec.frame)
    goal = targets.point(spec.target, here)
    weight = _weight(spec.weight, spec.axes)
    task = PositionTask(
        start.robot, spec.frame, goal, axes=spec.axes, name=name, weight=weight, **_law(spec)
    )
    return BuiltTask(task, _ramp(spec.ramp, here, goal, task.set_target))


def _inertia(name: str, spec: InertiaSpec, start: Snapshot) -> BuiltTask:
    given = spec.components
    components: Sequence[str] = INERTIA_COMPONENTS[given] if isinstance(given, str) else given
    here = _inertia_at(start, spec.frame)
    goal = targets.inertia(spec.target, components, here)
    task = InertiaTask(
        start.robot,
        goal,
        components=components,
        frame=spec.frame,
        per_mass=spec.per_mass,
        second_order=spec.second_order,
        name=name,
        weight=_weight(spec.weight, components),
        **_law(spec),
    )

    def hand_over(value: Array, rate: Array, _: Array) -> None:
        task.set_target(value, rate)

    return BuiltTask(task, _ramp(spec.ramp, here, goal, hand_over))


def _principal(name: str, spec: InertiaSpec, start: Snapshot) -> BuiltTask:
    if "frame" in spec.model_fields_set:
        raise Misplaced("principal moments are the same in every frame; leave this out", "frame")
    if spec.second_order:
        raise Misplaced("there is no second order for principal moments", "second_order")
    if not isinstance(spec.weight, float | int):
        raise Misplaced("principal moments take one weight, not a list", "weight")
    here = _inertia_at(start, "base")
    goal = targets.principal_moments(spec.target, here)
    task = PrincipalInertiaTask(
        start.robot, goal, per_mass=spec.per_mass, name=name, weight=spec.weight, **_law(spec)
    )

    def hand_over(value: Array, _: Array, __: Array) -> None:
        task.set_target(value)

    begin = targets.principal_moments("start", here)
    return BuiltTask(task, _ramp(spec.ramp, begin, goal, hand_over))


def _inertia_at(start: Snapshot, frame: str) -> Array:
    if frame != "world":
        start.robot.frame_id(frame)
    return strung(start.inertia_in(frame))


FixedSpec = OrientationSpec | PoseSpec | AxisSpec | PostureSpec | MomentumSpec


def _fixed(name: str, spec: FixedSpec, start: Snapshot) -> Task:
    """Return a task whose target does not move."""
    match spec:
        case OrientationSpec():
            return _orientation(name, spec, start)
        case PoseSpec():
            return _pose(name, spec, start)
        case AxisSpec():
            return _axis(name, spec, start)
        case PostureSpec():
            return _posture(name, spec, start)
        case MomentumSpec():
            return _momentum(name, spec, start)
        case _:
            assert_never(spec)


def _orientation(name: str, spec: OrientationSpec, start: Snapshot) -> Task:
    start.robot.frame_id(spec.frame)
    goal = targets.rotation(spec.target, start.rotation(spec.frame))
    weight = _weight(spec.weight, TURNS)
    return OrientationTask(start.robot, spec.frame, goal, name=name, weight=weight, **_law(spec))


def _pose(name: str, spec: PoseSpec, start: Snapshot) -> Task:
    start.robot.frame_id(spec.frame)
    target = PlacementTarget() if isinstance(spec.target, str) else spec.target
    return PoseTask(
        start.robot,
        spec.frame,
        targets.point(target.position, start.position(spec.frame)),
        targets.rotation(target.orientation, start.rotation(spec.frame)),
        name=name,
        weight=_weight(spec.weight, AXES + TURNS),
        **_law(spec),
    )


def _axis(name: str, spec: AxisSpec, start: Snapshot) -> Task:
    start.robot.frame_id(spec.frame)
    return AxisTask(
        start.robot,
        spec.frame,
        targets.point(spec.target, start.rotation(spec.frame) @ np.array(spec.axis)),
        axis=spec.axis,
        name=name,
        weight=_weight(spec.weight, AXES),
        **_law(spec),
    )


def _posture(name: str, spec: PostureSpec, start: Snapshot) -> Task:
    return PostureTask(
        start.robot,
        targets.posture(spec.target, start.robot, start.q),
        joints=spec.joints,
        name=name,
        weight=spec.weight,
        **_law(spec),
    )


def _momentum(name: str, spec: MomentumSpec, start: Snapshot) -> Task:
    given = spec.components
    components: Sequence[str] = MOMENTUM_COMPONENTS[given] if isinstance(given, str) else given
    return MomentumTask(
        start.robot,
        targets.momentum(spec.target, components, LINEAR + ANGULAR),
        components=components,
        name=name,
        weight=_weight(spec.weight, components),
        priority=spec.priority,
    )


def _weight(weight: float | Sequence[float], rows: Sequence[str]) -> ArrayLike:
    if not isinstance(weight, float | int) and len(weight) != len(rows):
        raise Misplaced(
            f"needs one number, or {len(rows)} ({', '.join(rows)}), got {len(weight)}", "weight"
        )
    return weight


def _law(spec: Any) -> dict[str, Any]:
    """Return the settings that every task with an error to remove has."""
    return {"gain": spec.gain, "lm_damping": spec.lm_damping, "priority": spec.priority}


def _ramp(
    duration: float | None,
    start: Array,
    goal: Array,
    hand_over: Callable[[Array, Array, Array], None],
) -> MovingTarget | None:
    if duration is None:
        return None
    return MovingTarget(MinimumJerk(start, goal, duration), hand_over)
