"""The tasks that a robot follows a human by, and their targets in each frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wbc.gait.legs import SIDES, Legs
from wbc.retargeting.body_map import BodyMap
from wbc.retargeting.targets import Targets
from wbc.robot import Robot
from wbc.robot.postures import STANDING
from wbc.tasks import AxisTask, ComTask, InertiaTask, OrientationTask, PoseTask, PostureTask, Task
from wbc.validate import Array, check_fields

TURNING = 0.1  # of m h sqrt(g h): angular momentum of who turns as a whole; who walks has a fifth
# Of a leg's length and of m h sqrt(g h): who moves and turns by less is followed more closely, by
# this at most.
STILL, QUIET, CLOSEST = 0.02, 0.01, 6.0


@dataclass(frozen=True)
class RetargetWeights:
    """Weights of the tasks; lengths count as parts of the legs', so one fits all robots.

    More is asked first of ``com``, ``momentum`` and ``lean`` (:data:`wbc.retargeting.tries.EAGER`).

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
    """Tasks of one robot, and how a frame's targets are put into them.

    Attributes
    ----------
    lasting:
        Tasks that have a target in every frame, about configurations.
    feet:
        Those of feet in the air, by side.
    momentum:
        Weights (3,) of the angular momentum, which all frames at once follow.
    inertia:
        About the ellipsoid.
    """

    def __init__(
        self, robot: Robot, body: BodyMap, targets: Targets, weights: RetargetWeights, legs: Legs
    ) -> None:
        w, standing = weights, robot.postures[STANDING]
        self.robot, self.body, self.targets, self.legs = robot, body, targets, legs
        start = robot.snapshot(standing)
        height = float(np.mean(targets.com[:, 2]))
        unit = robot.mass * height * np.sqrt(robot.gravity * height)
        moves = _closer(targets.com.std(axis=0) / (STILL * legs.length))
        self.com = ComTask(robot, start.com, weight=w.com / legs.length * moves, gain=1.0)
        rate = {body.pelvis: w.pelvis, body.trunk: w.trunk}
        if body.head is not None:
            rate[body.head] = w.head
        self.turns = {
            frame: OrientationTask(
                robot, frame, start.rotation(frame), name=frame, weight=weight, gain=1.0
            )
            for frame, weight in rate.items()
            if frame in targets.rotation
        }
        self.arms = {
            side: tuple(
                AxisTask(robot, frame, (0, 0, -1), axis=axis, name=name, weight=w.arms, gain=1.0)
                for frame, axis, name in (
                    (arm.upper_arm, arm.upper_axis, f"{side} upper arm"),
                    (arm.forearm, arm.forearm_axis, f"{side} forearm"),
                )
            )
            for side, arm in body.arms.items()
        }
        self.posture = PostureTask(robot, standing, weight=w.posture, gain=0.1)
        # What turns with all of its body has to get round: the momentum of a body of another shape
        # would leave it behind.
        most = np.abs(targets.angular_momentum).max(axis=0) / (TURNING * unit)
        turns = _closer(targets.angular_momentum.std(axis=0) / (QUIET * unit))
        self.momentum = w.momentum / unit * turns / (1.0 + most**2)
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
        self.ellipsoids: Array | None = None  # (n, 3, 3) [kg m^2], once they are known

    @property
    def lasting(self) -> tuple[Task, ...]:
        """Tasks about configurations that have a target in every frame."""
        arms = [task for pair in self.arms.values() for task in pair]
        return (self.com, *self.turns.values(), *arms, self.posture)

    def aim(self, k: int) -> None:
        """Set the targets of frame ``k``."""
        targets = self.targets
        self.com.set_target(targets.com[k])
        for frame, task in self.turns.items():
            task.set_target(targets.rotation[frame][k])
        for side, pair in self.arms.items():
            for one, way in zip(pair, targets.arms[side][k], strict=True):
                one.set_target(way)
        for side, foot in self.feet.items():
            foot.set_target(targets.feet.paths[side].place[k], self.rotations[side][k])

    def shape_like(self, inertia: Array, axes: Array) -> None:
        """Want the human's ellipsoid at the robot's own size, from now on.

        Its axes are the human's, and its moments change by the same factors as the human's do,
        about the means of those that the robot has along these axes.

        Parameters
        ----------
        inertia:
            That the robot has so far (n, 3, 3) [kg m^2].
        axes:
            The human's principal axes as columns (n, 3, 3).
        """
        theirs, mine = (
            np.einsum("nij,nik,nkj->nj", axes, one, axes) for one in (self.targets.inertia, inertia)
        )
        moments = mine.mean(axis=0) * theirs / theirs.mean(axis=0)
        found = np.einsum("nij,nj,nkj->nik", axes, moments, axes)
        self.ellipsoids = 0.5 * (found + np.swapaxes(found, 1, 2))


def _closer(part: Array) -> Array:
    """Return factors on weights (3,) by which a small motion is not lost among other tasks."""
    return np.minimum(np.sqrt(1.0 + 1.0 / np.maximum(part, 1e-9) ** 2), CLOSEST)
