"""From the description of a task to the task, and to what moves its target."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, assert_never

import numpy as np
from numpy.typing import ArrayLike

from wbc.problem import targets
from wbc.problem.mistakes import Misplaced
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
from wbc.run.ramps import (
    DIRECTIONS,
    PLACEMENTS,
    ROTATIONS,
    VECTORS,
    Configurations,
    TargetedTask,
    fixed_goal,
    placement,
    value_only,
)
from wbc.spatial import vech
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
)
from wbc.tasks.frame import TURNS
from wbc.tasks.inertia import ALL, DIAGONAL_COMPONENTS, TRACE
from wbc.tasks.momentum import ANGULAR, LINEAR
from wbc.tasks.point import AXES
from wbc.validate import Array

INERTIA_COMPONENTS = {"all": ALL, "diagonal": DIAGONAL_COMPONENTS, "trace": TRACE}
MOMENTUM_COMPONENTS = {"all": LINEAR + ANGULAR, "linear": LINEAR, "angular": ANGULAR}


def build_task(name: str, spec: TaskSpec, start: Snapshot) -> TargetedTask:
    """Return the task that ``spec`` describes, for a robot that starts at ``start``.

    Raises
    ------
    WbcError
        An unknown frame or joint, or numbers that do not fit.
    """
    match spec:
        case InertiaSpec(components="principal"):
            return _principal(name, spec, start)
        case InertiaSpec():
            return _inertia(name, spec, start)
        case ComSpec():
            return _com(name, spec, start)
        case PositionSpec():
            return _position(name, spec, start)
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


def _com(name: str, spec: ComSpec, start: Snapshot) -> TargetedTask:
    def goal(now: Snapshot, before: Array) -> Array:
        return targets.centre_of_mass(spec.target, start.com, now, before)

    task = ComTask(
        start.robot,
        goal(start, start.com),
        axes=spec.axes,
        name=name,
        weight=_weight(spec.weight, spec.axes),
        **_law(spec),
    )
    return TargetedTask(task, goal, lambda now: now.com, VECTORS, task.set_target, spec.ramp)


def _position(name: str, spec: PositionSpec, start: Snapshot) -> TargetedTask:
    start.robot.frame_id(spec.frame)
    goal = targets.point(spec.target, start.position(spec.frame))
    weight = _weight(spec.weight, spec.axes)
    task = PositionTask(
        start.robot, spec.frame, goal, axes=spec.axes, name=name, weight=weight, **_law(spec)
    )

    def current(now: Snapshot) -> Array:
        return now.position(spec.frame)

    return TargetedTask(task, fixed_goal(goal), current, VECTORS, task.set_target, spec.ramp)


def _inertia(name: str, spec: InertiaSpec, start: Snapshot) -> TargetedTask:
    given = spec.components
    components: Sequence[str] = INERTIA_COMPONENTS[given] if isinstance(given, str) else given

    def current(now: Snapshot) -> Array:
        return vech(now.inertia_in(spec.frame))

    if spec.frame != "world":
        start.robot.frame_id(spec.frame)
    goal = targets.inertia(spec.target, components, current(start))
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

    def set_target(value: Array, rate: Array, _: Array) -> None:
        task.set_target(value, rate)

    return TargetedTask(task, fixed_goal(goal), current, VECTORS, set_target, spec.ramp)


def _principal(name: str, spec: InertiaSpec, start: Snapshot) -> TargetedTask:
    if "frame" in spec.model_fields_set:
        raise Misplaced("principal moments are the same in every frame; leave this out", "frame")
    if spec.second_order:
        raise Misplaced("there is no second order for principal moments", "second_order")
    if not isinstance(spec.weight, float | int):
        raise Misplaced("principal moments take one weight, not a list", "weight")
    goal = targets.principal_moments(spec.target, vech(start.inertia))
    task = PrincipalInertiaTask(
        start.robot, goal, per_mass=spec.per_mass, name=name, weight=spec.weight, **_law(spec)
    )

    def current(now: Snapshot) -> Array:
        return np.linalg.eigvalsh(now.inertia)

    return TargetedTask(task, fixed_goal(goal), current, VECTORS, value_only(task), spec.ramp)


def _orientation(name: str, spec: OrientationSpec, start: Snapshot) -> TargetedTask:
    start.robot.frame_id(spec.frame)
    goal = targets.rotation(spec.target, start.rotation(spec.frame))
    weight = _weight(spec.weight, TURNS)
    task = OrientationTask(start.robot, spec.frame, goal, name=name, weight=weight, **_law(spec))

    def current(now: Snapshot) -> Array:
        return now.rotation(spec.frame)

    return TargetedTask(task, fixed_goal(goal), current, ROTATIONS, value_only(task))


def _pose(name: str, spec: PoseSpec, start: Snapshot) -> TargetedTask:
    start.robot.frame_id(spec.frame)
    target = PlacementTarget() if isinstance(spec.target, str) else spec.target
    position = targets.point(target.position, start.position(spec.frame))
    rotation = targets.rotation(target.orientation, start.rotation(spec.frame))
    task = PoseTask(
        start.robot,
        spec.frame,
        position,
        rotation,
        name=name,
        weight=_weight(spec.weight, AXES + TURNS),
        **_law(spec),
    )

    def current(now: Snapshot) -> Array:
        return placement(now.position(spec.frame), now.rotation(spec.frame))

    def set_target(value: Array, _: Array, __: Array) -> None:
        task.set_target(value[:, 3], value[:, :3])

    goal = fixed_goal(placement(position, rotation))
    return TargetedTask(task, goal, current, PLACEMENTS, set_target)


def _axis(name: str, spec: AxisSpec, start: Snapshot) -> TargetedTask:
    start.robot.frame_id(spec.frame)

    def current(now: Snapshot) -> Array:
        return now.rotation(spec.frame) @ task.axis

    pointing = start.rotation(spec.frame) @ np.array(spec.axis)
    task = AxisTask(
        start.robot,
        spec.frame,
        targets.point(spec.target, pointing),
        axis=spec.axis,
        name=name,
        weight=_weight(spec.weight, AXES),
        **_law(spec),
    )
    return TargetedTask(task, fixed_goal(task.target), current, DIRECTIONS, value_only(task))


def _posture(name: str, spec: PostureSpec, start: Snapshot) -> TargetedTask:
    robot = start.robot
    goal = targets.posture(spec.target, robot, start.q)
    task = PostureTask(robot, goal, joints=spec.joints, name=name, weight=spec.weight, **_law(spec))
    space = Configurations(robot)
    return TargetedTask(task, fixed_goal(goal), lambda now: now.q, space, value_only(task))


def _momentum(name: str, spec: MomentumSpec, start: Snapshot) -> TargetedTask:
    given = spec.components
    components: Sequence[str] = MOMENTUM_COMPONENTS[given] if isinstance(given, str) else given
    goal = targets.momentum(spec.target, components, LINEAR + ANGULAR)
    task = MomentumTask(
        start.robot,
        goal,
        components=components,
        name=name,
        weight=_weight(spec.weight, components),
        **_rank(spec),
    )
    return TargetedTask(task, fixed_goal(goal), lambda now: now.momentum, VECTORS, value_only(task))


def _weight(weight: float | Sequence[float], rows: Sequence[str]) -> ArrayLike:
    if not isinstance(weight, float | int) and len(weight) != len(rows):
        raise Misplaced(
            f"needs one number, or {len(rows)} ({', '.join(rows)}), got {len(weight)}", "weight"
        )
    return weight


def _law(spec: Any) -> dict[str, Any]:
    """Return the settings that every task with an error to remove has."""
    return {"gain": spec.gain, "lm_damping": spec.lm_damping, **_rank(spec)}


def _rank(spec: Any) -> dict[str, Any]:
    """Return the settings that every task has."""
    return {"priority": spec.priority, "singular_threshold": spec.singular_threshold}
