"""Orientation or pose of a frame of the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import ArrayLike

from wbc.laws import zero_rate
from wbc.native.rows import Kind, NativeRows
from wbc.robot import Robot, Snapshot
from wbc.rotations import check_rotation
from wbc.tasks.core_task import CoreTask
from wbc.tasks.keywords import Gains
from wbc.tasks.placement import PlacementTask
from wbc.tasks.point import AXES
from wbc.tasks.task import Aim
from wbc.validate import Array

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression, SymbolicPosture

TURNS = ("rx", "ry", "rz")
POSE_UNITS = dict.fromkeys(AXES, "m") | dict.fromkeys(TURNS, "rad")
_STILL = zero_rate((3,))


class OrientationTask(CoreTask):
    """Bring the axes of ``frame`` to the rotation ``target`` (3, 3).

    The error is the rotation vector log(target' R) [rad], in the target's axes; it is defined for
    less than half a turn, at which the way back is not unique.
    """

    frame: str

    _units = "rad"

    def __init__(
        self,
        robot: Robot,
        frame: str,
        target: ArrayLike,
        *,
        name: str | None = None,
        **law: Unpack[Gains],
    ) -> None:
        super().__init__(robot, f"{frame} orientation" if name is None else name, TURNS, **law)
        self.frame = frame
        self.set_target(target)

    def set_target(
        self,
        target: ArrayLike,
        rate: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> None:
        """Set the wanted rotation (3, 3) from frame axes to world axes.

        Parameters
        ----------
        rate, acceleration:
            If it turns: its angular velocity [rad/s] and acceleration (3,), world axes.
        """
        rotation = self._target(target, (3, 3))
        check_rotation(self, rotation, "target")
        self._set_rates((3,), rate, acceleration)
        self._assign(_goal=rotation)

    def native(self) -> tuple[NativeRows, ...]:
        """Return the three rows."""
        motion = self.target_rate, self.target_acceleration
        rows = native_orientation(self.frame, self._goal, *motion)
        return (rows._replace(moving=("", "", "_goal", "target_rate", "target_acceleration")),)

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return log(target' R) [rad]."""
        return posture.orientation_error(self.frame, self.target)


class PoseTask(PlacementTask, CoreTask):
    """Bring ``frame`` to a position and a rotation at once (rows x y z rx ry rz).

    Position (3,) [m], rotation (3, 3) and, if they move, their rates are in world axes.
    """

    frame: str

    _units = POSE_UNITS

    def __init__(
        self,
        robot: Robot,
        frame: str,
        position: ArrayLike,
        rotation: ArrayLike,
        *,
        name: str | None = None,
        **law: Unpack[Gains],
    ) -> None:
        super().__init__(robot, f"{frame} pose" if name is None else name, AXES + TURNS, **law)
        self.frame = frame
        self.set_target(position, rotation)

    def aim(self, snapshot: Snapshot) -> Aim:
        """Return the frame's origin and where it is wanted."""
        return Aim(snapshot.position(self.frame), self.position)

    def native(self) -> tuple[NativeRows, ...]:
        """Return the rows of the position above those of the rotation."""
        numbers = self.position, np.array((self.robot.mass,))
        rates, moving = (self._bias, self._drift), ("_bias", "_drift", "position")
        place = NativeRows(
            Kind.POINT, self.frame, (0, 1, 2), *rates, numbers, curved=False, moving=moving
        )
        motion = self._turn_rate, self._turn_acceleration
        turn = native_orientation(self.frame, self.rotation, *motion)
        turning = "", "", "rotation", "_turn_rate", "_turn_acceleration"
        return place, turn._replace(moving=turning)

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return position minus target [m] above log(target' R) [rad]."""
        return posture.pose_error(self.frame, self.position, self.rotation)


def native_orientation(
    frame: str, target: Array, target_rate: Array, target_acceleration: Array
) -> NativeRows:
    """Return what the core needs of a rotation: it adds the target's motion itself."""
    numbers = target.ravel(), target_rate, target_acceleration
    return NativeRows(Kind.ORIENTATION, frame, (0, 1, 2), _STILL, _STILL, numbers)
