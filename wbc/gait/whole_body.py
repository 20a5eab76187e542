"""The tasks and contacts by which a whole body walks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wbc.constraints import Contact, Limits
from wbc.constraints.friction import FrictionCone
from wbc.constraints.rows import Constraint
from wbc.controllers.torque import TorqueController
from wbc.gait.swing import FootPose, turned
from wbc.robot import Snapshot
from wbc.tasks import ComTask, MomentumTask, OrientationTask, PoseTask, PostureTask, Task
from wbc.validate import Array, check_fields

TRUNK = "base"


@dataclass(frozen=True)
class WalkingWeights:
    """Weights of the tasks, and how stiff they are.

    The spin of a swinging leg is the trunk's and the arms' to bear, as far as it goes: held to
    zero, it would take the pressure to the edge of the sole. About the vertical only friction holds
    a foot, so that is regulated more.

    Attributes
    ----------
    com, height, swing:
        Of the CoM in the plane, of its height, of the foot in the air [1/(m/s)].
    trunk, posture:
        [1/(rad/s)].
    spin, yaw:
        Of the angular momentum about x and y, and z, in units of mass times height squared
        [1/(m^2 rad/s)].
    stiff_height, stiff_trunk, stiff_posture, stiff_swing:
        Their ``kp`` [1/s^2].
    """

    com: float = 30.0
    height: float = 30.0
    swing: float = 10.0
    trunk: float = 1.0
    posture: float = 0.3
    spin: float = 0.4
    yaw: float = 10.0
    stiff_height: float = 100.0
    stiff_trunk: float = 100.0
    stiff_posture: float = 30.0
    stiff_swing: float = 900.0

    def __post_init__(self) -> None:
        check_fields(self, "walking weights, ", *self.__dataclass_fields__, above=0.0)


class WholeBody:
    """Tasks for the CoM, the trunk, the feet and the posture, and the controller that has them.

    Attributes
    ----------
    controller:
        The :class:`~wbc.controllers.torque.TorqueController`.
    """

    def __init__(
        self,
        start: Snapshot,
        heading: float,
        height: float,
        weights: WalkingWeights,
        friction: FrictionCone,
        *,
        tasks: Sequence[Task] = (),
        limits: Limits | None,
        constraints: Sequence[Constraint] = (),
        dt: float,
        **settings: Any,
    ) -> None:
        robot, w = start.robot, weights
        self._friction = friction
        self._frames = {foot: sole.frame for foot, sole in robot.feet.items()}
        self._swing_weight = w.swing
        self._upright = turned(-heading) @ start.rotation(TRUNK)
        inertia = robot.mass * height**2
        # The law of the CoM is the walker's: its target is where it is, with an acceleration.
        self._com = ComTask(robot, start.com, axes=["x", "y"], kp=0.0, kd=0.0, weight=w.com)
        self._height = ComTask(
            robot, start.com, axes=["z"], name="height", kp=w.stiff_height, weight=w.height
        )
        self._trunk = OrientationTask(
            robot, TRUNK, start.rotation(TRUNK), name="trunk", kp=w.stiff_trunk, weight=w.trunk
        )
        self._swing = {
            foot: PoseTask(
                robot,
                frame,
                start.position(frame),
                start.rotation(frame),
                name=f"{foot} foot",
                kp=w.stiff_swing,
                weight=w.swing,
            )
            for foot, frame in self._frames.items()
        }
        own: list[Task] = [
            self._com,
            self._height,
            self._trunk,
            MomentumTask(robot, components=["kx", "ky"], name="spin", weight=w.spin / inertia),
            MomentumTask(robot, components=["kz"], name="yaw", weight=w.yaw / inertia),
            PostureTask(robot, start.q, kp=w.stiff_posture, weight=w.posture),
            *self._swing.values(),
        ]
        self.controller = TorqueController(
            robot,
            [*own, *tasks],
            contacts=self._held(start, self._frames),
            limits=limits,
            constraints=constraints,
            dt=dt,
            **settings,
        )
        for task in self._swing.values():
            task.weight = 0.0

    def _held(self, snapshot: Snapshot, feet: Iterable[str]) -> list[Contact]:
        frames = [self._frames[foot] for foot in feet]
        return [Contact.hold(snapshot, frame, friction=self._friction) for frame in frames]

    def hold(self, snapshot: Snapshot, feet: Iterable[str], ramp: float) -> None:
        """Let feet bear from now on, where they are; others are relieved within ``ramp`` [s]."""
        feet = tuple(feet)
        self.controller.set_contacts(self._held(snapshot, feet), ramp=ramp)
        for foot in feet:
            self._swing[foot].weight = 0.0

    def swing(self, foot: str, pose: FootPose) -> None:
        """Lead a foot through the air."""
        task = self._swing[foot]
        if not task.weight.any():
            task.weight = self._swing_weight
        task.set_target(*pose)

    def lead(
        self, snapshot: Snapshot, acceleration: Array, height: Array, heading: float, turn: float
    ) -> None:
        """Set the CoM's acceleration (2,) [m/s^2], its height with rates (3,), and the heading.

        ``turn`` is the heading's rate [rad/s].
        """
        now, rate = snapshot.com, snapshot.com_jacobian @ snapshot.v
        self._com.set_target(now, rate, (*acceleration, 0.0))
        z, z1, z2 = height.tolist()
        self._height.set_target((0.0, 0.0, z), (0.0, 0.0, z1), (0.0, 0.0, z2))
        self._trunk.set_target(turned(heading) @ self._upright, (0.0, 0.0, turn))


def heading_of(rotations: Iterable[Array]) -> float:
    """Return the mean heading of frames' x axes [rad]."""
    ahead = np.sum([R[:2, 0] for R in rotations], axis=0)
    return math.atan2(ahead[1], ahead[0])
