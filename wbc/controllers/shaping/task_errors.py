"""The errors of tasks as expressions of the posture: one function for each kind of task.

They are what ``task.residual(snapshot).error`` is at a snapshot, and the tests hold them to that.
Where the QP linearises, the NLP goes on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import singledispatch

import casadi as ca
import numpy as np

from wbc.errors import InvalidInputError
from wbc.robot.snapshot import BASE
from wbc.robot.symbolic import SymbolicPosture, rotation_log
from wbc.robot.symbolic.posture import vech_symbolic
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
from wbc.tasks.inertia import TRACE
from wbc.tasks.point import AXES


@dataclass(frozen=True, eq=False)
class Scene:
    """What errors are expressions of.

    Attributes
    ----------
    posture:
        The robot in the world.
    joints:
        Joint positions (nv-6, 1) [rad or m].
    axes:
        For each task of principal moments, the rotation (3, 3) from the axes that its target
        moments are about to base axes: an unknown of its own.
    """

    posture: SymbolicPosture
    joints: ca.SX
    axes: Mapping[str, ca.SX]


@singledispatch
def symbolic_error(task: Task, scene: Scene) -> ca.SX:
    """Return the error (k, 1) of a task.

    Raises
    ------
    InvalidInputError
        A kind of task that says nothing about postures, or is not known here.
    """
    raise InvalidInputError(
        f"global shaping: task {task.name!r} is a {type(task).__name__}, of which no error in terms"
        " of the posture is known; leave it to the controller"
    )


@symbolic_error.register
def _(task: MomentumTask, scene: Scene) -> ca.SX:
    raise InvalidInputError(
        f"global shaping: task {task.name!r} is about momentum, that is about velocities; a posture"
        " has none. Leave it to the controller that moves there"
    )


@symbolic_error.register
def _(task: InertiaTask, scene: Scene) -> ca.SX:
    # The trace is the same in all axes; in the base's it is an expression of the joints alone.
    frame = BASE if task.rows == TRACE else task.frame
    actual = vech_symbolic(scene.posture.inertia_in(frame))
    return ca.mtimes(ca.DM(task.selection), actual - ca.DM(task.target))


@symbolic_error.register
def _(task: PrincipalInertiaTask, scene: Scene) -> ca.SX:
    """Return I - N with N any matrix of the wanted moments, its axes being unknowns.

    The nearest such N is what the task's error is measured from (Hoffman and Wielandt): minimising
    over the axes too gives the same cost, with no eigenvalues that cross.
    """
    if np.ptp(task.weight) > 0.0:
        raise InvalidInputError(
            f"global shaping: task {task.name!r} weighs its six rows differently; give one weight"
        )
    R = scene.axes[task.name]
    nearest = ca.mtimes(ca.mtimes(R, ca.DM(np.diag(task.target))), R.T)
    actual = scene.posture.inertia_in(BASE)
    return ca.mtimes(ca.DM(task.selection), vech_symbolic(actual - nearest))


@symbolic_error.register
def _(task: ComTask, scene: Scene) -> ca.SX:
    return (scene.posture.com - ca.DM(task.target))[_axis_rows(task)]


@symbolic_error.register
def _(task: PositionTask, scene: Scene) -> ca.SX:
    return (scene.posture.position(task.frame) - ca.DM(task.target))[_axis_rows(task)]


@symbolic_error.register
def _(task: OrientationTask, scene: Scene) -> ca.SX:
    return rotation_log(ca.mtimes(ca.DM(task.target).T, scene.posture.rotation(task.frame)))


@symbolic_error.register
def _(task: PoseTask, scene: Scene) -> ca.SX:
    place = scene.posture.position(task.frame) - ca.DM(task.position)
    relative = ca.mtimes(ca.DM(task.rotation).T, scene.posture.rotation(task.frame))
    return ca.vertcat(place, rotation_log(relative))


@symbolic_error.register
def _(task: AxisTask, scene: Scene) -> ca.SX:
    pointing = ca.mtimes(scene.posture.rotation(task.frame), ca.DM(task.axis))
    return pointing - ca.DM(task.target)


@symbolic_error.register
def _(task: PostureTask, scene: Scene) -> ca.SX:
    robot = task.robot
    wanted = robot.limits.joint_positions(task.target)
    errors = []
    for name in task.rows:
        k = robot.joint_index(name) - 6
        error = scene.joints[k] - float(wanted[k])
        if k in robot.limits.unbounded:  # the shorter way round
            error = ca.atan2(ca.sin(error), ca.cos(error))
        errors.append(error)
    return ca.vertcat(*errors)


def _axis_rows(task: ComTask | PositionTask) -> list[int]:
    return [AXES.index(row) for row in task.rows]
