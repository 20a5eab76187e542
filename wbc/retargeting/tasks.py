"""The tasks that a robot follows a human by, and their targets in each frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wbc.gait.legs import SIDES
from wbc.retargeting.robot_setup import RobotSetup
from wbc.retargeting.targets import Targets
from wbc.robot.postures import STANDING
from wbc.tasks import AxisTask, ComTask, InertiaTask, OrientationTask, PoseTask, PostureTask, Task
from wbc.validate import Array, check_fields

# Of m h sqrt(g h): angular momentum of a body that rotates as a whole; walking has a fifth of it.
ROTATION_MOMENTUM = 0.1
# Motions with a smaller standard deviation of the CoM (by a leg's length) or of the angular
# momentum (by m h sqrt(g h)) get higher weights, by the factor at most.
SMALL_COM_MOTION, SMALL_MOMENTUM, MAX_SMALL_MOTION_FACTOR = 0.02, 0.01, 6.0


@dataclass(frozen=True)
class RetargetWeights:
    """Weights of the tasks; lengths are divided by the legs', so that one set fits all robots.

    The first attempt has higher weights of ``com``, ``momentum`` and ``lean``
    (:data:`wbc.retargeting.retries.FIRST_ATTEMPT`).

    Attributes
    ----------
    com, feet:
        Of the CoM and of the feet in the air, by a leg's length.
    tilt:
        Of these feet's rotation [1/rad].
    trunk, pelvis, head, arms:
        Of their rotations, and of the directions of upper arms and forearms [1/rad].
    momentum:
        Of the angular momentum by m h sqrt(g h).
    inertia, lean:
        Of the ellipsoid, by that of the robot's own size; and of how its long axis leans.
    posture:
        Of all joints, towards standing [1/rad].
    """

    com: float = 40.0
    feet: float = 20.0
    tilt: float = 2.0
    trunk: float = 1.5
    pelvis: float = 0.5
    head: float = 0.5
    arms: float = 0.6
    momentum: float = 160.0
    inertia: float = 1.0
    lean: float = 1.0
    posture: float = 0.15

    def __post_init__(self) -> None:
        check_fields(self, "retarget, weights, ", *self.__dataclass_fields__, above=0.0)


class FrameTasks:
    """Tasks of one robot; :meth:`set_targets` gives them a frame's targets.

    ``feet``: tasks of feet in the air, by side.
    ``momentum``: weights (3,) of the angular momentum, a task of the whole motion.
    ``inertia``: of the ellipsoid.
    ``inertia_targets``: its targets (n, 3, 3) [kg m^2], once they are known.
    """

    def __init__(self, setup: RobotSetup, targets: Targets, weights: RetargetWeights) -> None:
        robot, body, legs = setup.robot, setup.body, setup.legs
        w, standing = weights, robot.postures[STANDING]
        self.robot, self.body, self.targets, self.legs = robot, body, targets, legs
        start = robot.snapshot(standing)
        height = float(np.mean(targets.com[:, 2]))
        unit = robot.mass * height * np.sqrt(robot.gravity * height)
        com_factor = _small_motion_factor(
            targets.com.std(axis=0) / (SMALL_COM_MOTION * legs.length)
        )
        self.com = ComTask(robot, start.com, weight=w.com / legs.length * com_factor, gain=1.0)
        weight_of = {body.pelvis: w.pelvis, body.trunk: w.trunk, body.head: w.head}
        self.orientations = {
            frame: OrientationTask(
                robot, frame, start.rotation(frame), name=frame, weight=weight_of[frame], gain=1.0
            )
            for frame in targets.rotation
        }

        def along(axis: Array, frame: str, name: str) -> AxisTask:
            return AxisTask(robot, frame, (0, 0, -1), axis=axis, name=name, weight=w.arms, gain=1.0)

        self.arms = {
            side: tuple(along(axis, frame, f"{side} {name}") for name, frame, axis in arm.segments)
            for side, arm in body.arms.items()
        }
        self.posture = PostureTask(robot, standing, weight=w.posture, gain=1.0)
        # A body that rotates as a whole has to complete its rotation, which with another inertia
        # takes another momentum than the human's.
        k = targets.angular_momentum
        rotating = np.abs(k).max(axis=0) / (ROTATION_MOMENTUM * unit)
        factor = _small_motion_factor(k.std(axis=0) / (SMALL_MOMENTUM * unit))
        self.momentum = w.momentum / unit * factor / (1.0 + rotating**2)
        size = float(np.trace(start.inertia))
        entries = np.array([w.inertia, w.inertia, w.lean, w.inertia, w.lean, w.inertia]) / size
        self.inertia = InertiaTask(robot, start.inertia, weight=entries, gain=1.0)
        foot = np.array([w.feet / legs.length] * 3 + [w.tilt] * 3)
        self.feet = {}
        for side in SIDES:
            frame = robot.feet[side].frame
            pose = start.position(frame), start.rotation(frame)
            self.feet[side] = PoseTask(
                robot, frame, *pose, name=f"{side} foot", weight=foot, gain=1.0
            )
        self.rotations = {side: targets.feet.paths[side].rotation for side in SIDES}
        self.foot_weight = foot
        self.inertia_targets: Array | None = None

    @property
    def configuration_tasks(self) -> tuple[Task, ...]:
        """Tasks of the configuration that have a target in every frame."""
        arms = [task for pair in self.arms.values() for task in pair]
        return (self.com, *self.orientations.values(), *arms, self.posture)

    def set_targets(self, k: int) -> None:
        """Set the targets of frame ``k``."""
        targets = self.targets
        self.com.set_target(targets.com[k])
        for frame, task in self.orientations.items():
            task.set_target(targets.rotation[frame][k])
        for side, pair in self.arms.items():
            for one, direction in zip(pair, targets.arms[side][k], strict=True):
                one.set_target(direction)
        for side, foot in self.feet.items():
            foot.set_target(targets.feet.paths[side].place[k], self.rotations[side][k])

    def set_inertia_targets(self, inertia: Array, axes: Array) -> None:
        """Set the targets of the ellipsoid: the human's, at the robot's own size.

        The axes are the human's. The moments are the robot's mean ones along these axes, times the
        human's by their means.

        ``inertia``: of the robot in its present motion (n, 3, 3) [kg m^2]; ``axes``: the human's
        principal axes as columns (n, 3, 3).
        """
        human, robot = (
            np.einsum("nij,nik,nkj->nj", axes, one, axes) for one in (self.targets.inertia, inertia)
        )
        moments = robot.mean(axis=0) * human / human.mean(axis=0)
        found = np.einsum("nij,nj,nkj->nik", axes, moments, axes)
        self.inertia_targets = 0.5 * (found + np.swapaxes(found, 1, 2))


def _small_motion_factor(ratio: Array) -> Array:
    """Return factors (3,) on weights, so that other tasks do not hide a small motion."""
    factor = np.sqrt(1.0 + 1.0 / np.maximum(ratio, 1e-9) ** 2)
    return np.minimum(factor, MAX_SMALL_MOTION_FACTOR)
