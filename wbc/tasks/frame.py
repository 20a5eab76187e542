"""Orientation or pose of a frame of the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import ArrayLike

from wbc.laws import Residual, at_rest
from wbc.native.rows import Kind, NativeRows
from wbc.robot import Robot, Snapshot
from wbc.rotations import check_rotation, log_jacobian, log_jacobian_rate, log_rotation
from wbc.spatial import skew
from wbc.tasks.keywords import Gains
from wbc.tasks.placement import PlacementTask
from wbc.tasks.point import AXES
from wbc.tasks.task import Aim, Task
from wbc.validate import Array

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression, SymbolicPosture

TURNS = ("rx", "ry", "rz")
_STILL = at_rest((3,))


class OrientationTask(Task):
    """Bring the axes of ``frame`` to the rotation ``target`` (3, 3).

    The error is the rotation vector log(target' R) [rad], in the target's axes; it is defined for
    less than half a turn, at which the way back is not unique.
    """

    frame: str

    def __init__(
        self,
        robot: Robot,
        frame: str,
        target: ArrayLike,
        *,
        name: str | None = None,
        **law: Unpack[Gains],
    ) -> None:
        super().__init__(robot, name or f"{frame} orientation", TURNS, **law)
        robot.frame_id(frame)
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
        check_rotation(f"task {self.name!r}, target", rotation)
        self._set_rates((3,), rate, acceleration)
        self._assign(_goal=rotation)

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return log(target' R) [rad]."""
        return orientation_residual(snapshot, self.frame, self._goal, self.target_rate)

    def native(self) -> tuple[NativeRows, ...]:
        """Return the three rows."""
        motion = self.target_rate, self.target_acceleration
        rows = native_orientation(self.frame, self._goal, *motion)
        return (rows._replace(moving=("", "", "_goal", "target_rate", "target_acceleration")),)

    @property
    def units(self) -> tuple[str, ...]:
        """Radians."""
        return ("rad",) * 3

    def drift(self, snapshot: Snapshot) -> Array:
        """Return the error's second derivative at v' = 0 [rad/s^2], the target's motion in it."""
        return orientation_drift(
            snapshot, self.frame, self._goal, self.target_rate, self.target_acceleration
        )

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return log(target' R) [rad]."""
        return posture.orientation_error(self.frame, self.target)


class PoseTask(PlacementTask):
    """Bring ``frame`` to a position and a rotation at once (rows x y z rx ry rz).

    Position (3,) [m], rotation (3, 3) and, if they move, their rates are in world axes.
    """

    frame: str

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
        super().__init__(robot, name or f"{frame} pose", AXES + TURNS, **law)
        robot.frame_id(frame)
        self.frame = frame
        self.set_target(position, rotation)

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return position minus target [m] above log(target' R) [rad]."""
        turn = orientation_residual(snapshot, self.frame, self.rotation, self._turn_rate)
        error = np.concatenate((snapshot.position(self.frame) - self.position, turn.error))
        jacobian = np.concatenate((snapshot.jacobian(self.frame)[:3], turn.jacobian))
        return Residual(error, jacobian, np.concatenate((self._bias, turn.bias)))

    def aim(self, snapshot: Snapshot) -> Aim:
        """Return the frame's origin and where it is wanted."""
        return Aim(snapshot.position(self.frame), self.position)

    def native(self) -> tuple[NativeRows, ...]:
        """Return the rows of the position above those of the rotation."""
        place = NativeRows(
            Kind.POINT,
            self.frame,
            (0, 1, 2),
            self._bias,
            self._drift,
            (self.position, np.array((self.robot.mass,))),
            curved=False,
            moving=("_bias", "_drift", "position"),
        )
        motion = self._turn_rate, self._turn_acceleration
        turn = native_orientation(self.frame, self.rotation, *motion)
        moving = "", "", "rotation", "_turn_rate", "_turn_acceleration"
        return place, turn._replace(moving=moving)

    @property
    def units(self) -> tuple[str, ...]:
        """Metres, then radians."""
        return ("m",) * 3 + ("rad",) * 3

    def drift(self, snapshot: Snapshot) -> Array:
        """Return the drift of both parts, the target's motion in it."""
        motion = self._turn_rate, self._turn_acceleration
        turn = orientation_drift(snapshot, self.frame, self.rotation, *motion)
        return np.concatenate((snapshot.drift(self.frame)[:3] + self._drift, turn))

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return position minus target [m] above log(target' R) [rad]."""
        return posture.pose_error(self.frame, self.position, self.rotation)


def native_orientation(
    frame: str, target: Array, target_rate: Array, target_acceleration: Array
) -> NativeRows:
    """Return what the native core needs of a rotation's residual and drift: it adds both motions.

    See :func:`orientation_residual` and :func:`orientation_drift`.
    """
    numbers = target.ravel(), target_rate, target_acceleration
    return NativeRows(Kind.ORIENTATION, frame, (0, 1, 2), _STILL, _STILL, numbers)


def orientation_residual(
    snapshot: Snapshot, frame: str, target: Array, target_rate: Array
) -> Residual:
    """Return the error log(R*' R) (3,) and its first derivative.

    R*' R turns at R'(w - w*) in its own axes.
    """
    R = snapshot.rotation(frame)
    relative = target.T.dot(R)
    to_error = log_jacobian(relative).dot(R.T)  # world angular velocity -> rate of the error
    jacobian = to_error.dot(snapshot.jacobian(frame)[3:])
    bias = _STILL if target_rate is _STILL else -to_error.dot(target_rate)
    return Residual(log_rotation(relative), jacobian, bias)


def orientation_drift(
    snapshot: Snapshot, frame: str, target: Array, target_rate: Array, target_acceleration: Array
) -> Array:
    """Return the second derivative (3,) of log(R*' R) at zero acceleration of v.

    d/dt R'(w - w*) = R'(w' - w*' + w x w*).
    """
    R = snapshot.rotation(frame)
    w = snapshot.jacobian(frame)[3:].dot(snapshot.v)
    alpha = snapshot.drift(frame)[3:] - target_acceleration
    alpha += skew(w).dot(target_rate)
    return log_drift(target.T.dot(R), R.T.dot(w - target_rate), R.T.dot(alpha))


def log_drift(relative: Array, w: Array, alpha: Array) -> Array:
    """Return d2/dt2 log(Q) (3,) of a rotation Q that turns at ``w`` and ``alpha`` in its axes."""
    J = log_jacobian(relative)
    drift: Array = J.dot(alpha)
    drift += log_jacobian_rate(log_rotation(relative), J.dot(w), w)
    return drift
