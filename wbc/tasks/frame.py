"""Position, orientation, pose or axis of a frame of the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.laws import Residual
from wbc.robot import Robot, Snapshot
from wbc.rotations import check_rotation, log_jacobian, log_jacobian_rate, log_rotation
from wbc.spatial import skew
from wbc.tasks.point import AXES
from wbc.tasks.task import Gains, Task
from wbc.validate import Array

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression, SymbolicPosture

TURNS = ("rx", "ry", "rz")


class OrientationTask(Task):
    """Bring the axes of ``frame`` to the rotation ``target`` (3, 3).

    The error is the rotation vector log(target' R) [rad], in the target's axes; it is defined for
    less than half a turn, at which the way back is not unique.
    """

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
        self._none = self._zeros()
        self.set_target(target)

    def set_target(self, target: ArrayLike) -> None:
        """Set the wanted rotation (3, 3) from frame axes to world axes."""
        rotation = self._target(target, (3, 3))
        check_rotation(f"task {self.name!r}, target", rotation)
        self._goal = rotation

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return log(target' R) [rad]."""
        error, jacobian = orientation_residual(snapshot, self.frame, self.target)
        return Residual(error, jacobian, self._none)

    @property
    def units(self) -> tuple[str, ...]:
        """Radians."""
        return ("rad",) * 3

    def drift(self, snapshot: Snapshot) -> Array:
        """Return the rate of the error's Jacobian times v [rad/s^2]."""
        return orientation_drift(snapshot, self.frame, self.target)

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return log(target' R) [rad]."""
        return posture.orientation_error(self.frame, self.target)


class PoseTask(Task):
    """Bring ``frame`` to a position and a rotation at once (rows x y z rx ry rz)."""

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
        self._none = self._zeros()
        self.set_target(position, rotation)

    def set_target(self, position: ArrayLike, rotation: ArrayLike) -> None:
        """Set the wanted position (3,) [m] and rotation (3, 3)."""
        place = self._target(position, (3,), "position")
        turn = self._target(rotation, (3, 3), "rotation")
        check_rotation(f"task {self.name!r}, rotation", turn)
        self.position, self.rotation = place, turn

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return position minus target [m] above log(target' R) [rad]."""
        turn, turn_jacobian = orientation_residual(snapshot, self.frame, self.rotation)
        error = np.concatenate((snapshot.position(self.frame) - self.position, turn))
        jacobian = np.concatenate((snapshot.jacobian(self.frame)[:3], turn_jacobian))
        return Residual(error, jacobian, self._none)

    @property
    def units(self) -> tuple[str, ...]:
        """Metres, then radians."""
        return ("m",) * 3 + ("rad",) * 3

    def drift(self, snapshot: Snapshot) -> Array:
        """Return the drift of both parts."""
        turn = orientation_drift(snapshot, self.frame, self.rotation)
        return np.concatenate((snapshot.drift(self.frame)[:3], turn))

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return position minus target [m] above log(target' R) [rad]."""
        return posture.pose_error(self.frame, self.position, self.rotation)


class AxisTask(Task):
    """Point a body-fixed ``axis`` of ``frame`` along the world direction ``target``.

    The error is the difference of the two unit vectors (3 rows of rank 2): smooth everywhere, and
    the opposite direction is a saddle rather than a second rest point.
    """

    def __init__(
        self,
        robot: Robot,
        frame: str,
        target: ArrayLike,
        *,
        axis: ArrayLike = (0, 0, 1),
        name: str | None = None,
        **law: Unpack[Gains],
    ) -> None:
        super().__init__(robot, name or f"{frame} axis", AXES, **law)
        robot.frame_id(frame)
        self.frame = frame
        self.axis = self._unit(axis, "axis")
        self._none = self._zeros()
        self.set_target(target)

    def set_target(self, target: ArrayLike) -> None:
        """Set the wanted direction (3,), of any length but zero."""
        self._goal = self._unit(target, "target")

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return the axis minus the target, both unit vectors in world axes."""
        pointing = snapshot.rotation(self.frame) @ self.axis
        jacobian = -skew(pointing) @ snapshot.jacobian(self.frame)[3:]
        return Residual(pointing - self.target, jacobian, self._none)

    @property
    def units(self) -> tuple[str, ...]:
        """None: entries of a unit vector."""
        return ("1",) * 3

    def drift(self, snapshot: Snapshot) -> Array:
        """Return w x (w x a) + alpha x a at zero acceleration of v [1/s^2]."""
        pointing = snapshot.rotation(self.frame) @ self.axis
        w = snapshot.jacobian(self.frame)[3:] @ snapshot.v
        alpha = snapshot.drift(self.frame)[3:]
        return np.cross(w, np.cross(w, pointing)) + np.cross(alpha, pointing)

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return the axis minus the target, both unit vectors in world axes."""
        return posture.rotation(self.frame) @ self.axis - self.target

    def _unit(self, value: ArrayLike, what: str) -> Array:
        vector = self._target(value, (3,), what)
        length = float(np.linalg.norm(vector))
        if length < 1e-9:
            raise InvalidInputError(f"task {self.name!r}, {what}: a direction needs some length")
        return vector / length


def orientation_residual(snapshot: Snapshot, frame: str, target: Array) -> tuple[Array, Array]:
    """Return the error log(target' R) (3,) and its Jacobian (3, nv)."""
    R = snapshot.rotation(frame)
    relative = target.T @ R
    to_error = log_jacobian(relative) @ R.T  # world angular velocity -> rate of the error
    return log_rotation(relative), to_error @ snapshot.jacobian(frame)[3:]


def orientation_drift(snapshot: Snapshot, frame: str, target: Array) -> Array:
    """Return the second derivative (3,) of log(target' R) at zero acceleration of v."""
    R = snapshot.rotation(frame)
    relative = target.T @ R
    J = log_jacobian(relative)
    w = R.T @ (snapshot.jacobian(frame)[3:] @ snapshot.v)
    alpha = R.T @ snapshot.drift(frame)[3:]
    return J @ alpha + log_jacobian_rate(log_rotation(relative), J @ w) @ w
