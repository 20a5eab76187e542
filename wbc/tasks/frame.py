"""Position, orientation, pose or axis of a frame of the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.laws import Residual
from wbc.native.rows import Kind, NativeRows
from wbc.robot import Robot, Snapshot
from wbc.rotations import check_rotation, log_jacobian, log_jacobian_rate, log_rotation
from wbc.spatial import skew
from wbc.tasks.point import AXES
from wbc.tasks.task import Aim, Gains, Task
from wbc.validate import Array, finite_array, read_only

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
        self._goal = rotation

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return log(target' R) [rad]."""
        return orientation_residual(snapshot, self.frame, self._goal, self.target_rate)

    def native(self) -> tuple[NativeRows, ...]:
        """Return the three rows."""
        rate, acceleration = self.target_rate, self.target_acceleration
        return (native_orientation(self.frame, self._goal, rate, acceleration),)

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
        self.set_target(position, rotation)

    def set_target(
        self,
        position: ArrayLike,
        rotation: ArrayLike,
        rate: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> None:
        """Set the wanted position (3,) [m] and rotation (3, 3).

        Parameters
        ----------
        rate, acceleration:
            If they move: velocity [m/s] and angular velocity [rad/s] (6,), and the derivatives of
            both, world axes.
        """
        place = self._target(position, (3,), "position")
        turn = self._target(rotation, (3, 3), "rotation")
        check_rotation(f"task {self.name!r}, rotation", turn)
        self._set_rates((6,), rate, acceleration)
        self.position, self.rotation = place, turn
        self._goal = read_only(homogeneous(place, turn))

    @property
    def target(self) -> Array:
        """Position and rotation as one homogeneous matrix (4, 4); may be assigned."""
        return self._goal

    @target.setter
    def target(self, value: ArrayLike) -> None:
        self.set_target(*placement_of(f"{self}, target", value))

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return position minus target [m] above log(target' R) [rad]."""
        turn = orientation_residual(snapshot, self.frame, self.rotation, self.target_rate[3:])
        error = np.concatenate((snapshot.position(self.frame) - self.position, turn.error))
        jacobian = np.concatenate((snapshot.jacobian(self.frame)[:3], turn.jacobian))
        return Residual(error, jacobian, np.concatenate((-self.target_rate[:3], turn.bias)))

    def aim(self, snapshot: Snapshot) -> Aim:
        """Return the frame's origin and where it is wanted."""
        return Aim(snapshot.position(self.frame), self.position)

    def native(self) -> tuple[NativeRows, ...]:
        """Return the rows of the position above those of the rotation."""
        rate, acceleration = self.target_rate, self.target_acceleration
        place = NativeRows(
            Kind.POINT,
            self.frame,
            (0, 1, 2),
            -rate[:3],
            -acceleration[:3],
            (self.position, np.array((self.robot.mass,))),
            curved=False,
        )
        turn = native_orientation(self.frame, self.rotation, rate[3:], acceleration[3:])
        return place, turn

    @property
    def units(self) -> tuple[str, ...]:
        """Metres, then radians."""
        return ("m",) * 3 + ("rad",) * 3

    def drift(self, snapshot: Snapshot) -> Array:
        """Return the drift of both parts, the target's motion in it."""
        rate, acceleration = self.target_rate, self.target_acceleration
        turn = orientation_drift(snapshot, self.frame, self.rotation, rate[3:], acceleration[3:])
        return np.concatenate((snapshot.drift(self.frame)[:3] - acceleration[:3], turn))

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
        self.set_target(target)

    def set_target(
        self,
        target: ArrayLike,
        rate: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> None:
        """Set the wanted direction (3,), of any length but zero.

        Parameters
        ----------
        rate, acceleration:
            If it moves: its derivatives (3,), of ``target`` as given; changes of length do not
            count. Afterwards ``target_rate`` is that of the unit vector.
        """
        goal = self._unit(target, "target")
        self._set_rates((3,), rate, acceleration)
        n = float(np.linalg.norm(np.asarray(target, dtype=float)))
        # With d = n u: d' = n u' + n' u and d'' = n u'' + 2 n' u' + n'' u, where u'.u = 0.
        d1, d2 = self.target_rate, self.target_acceleration
        stretch = float(goal @ d1)
        u1 = (d1 - stretch * goal) / n
        u2 = (d2 - 2.0 * stretch * u1 - (float(u1 @ d1) + float(goal @ d2)) * goal) / n
        self._goal, self.target_rate, self.target_acceleration = goal, read_only(u1), read_only(u2)
        self._bias = read_only(-u1)

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return the axis minus the target, both unit vectors in world axes."""
        pointing = snapshot.rotation(self.frame) @ self.axis
        jacobian = -skew(pointing) @ snapshot.jacobian(self.frame)[3:]
        return Residual(pointing - self._goal, jacobian, self._bias)

    @property
    def units(self) -> tuple[str, ...]:
        """None: entries of a unit vector."""
        return ("1",) * 3

    def drift(self, snapshot: Snapshot) -> Array:
        """Return w x (w x a) + alpha x a at v' = 0, less the target's second derivative."""
        pointing = snapshot.rotation(self.frame) @ self.axis
        w = snapshot.jacobian(self.frame)[3:] @ snapshot.v
        alpha = snapshot.drift(self.frame)[3:]
        own = np.cross(w, np.cross(w, pointing)) + np.cross(alpha, pointing)
        return np.asarray(own - self.target_acceleration)

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return the axis minus the target, both unit vectors in world axes."""
        return posture.rotation(self.frame) @ self.axis - self.target

    def _unit(self, value: ArrayLike, what: str) -> Array:
        vector = self._target(value, (3,), what)
        length = float(np.linalg.norm(vector))
        if length < 1e-9:
            raise InvalidInputError(f"task {self.name!r}, {what}: a direction needs some length")
        return vector / length


def native_orientation(
    frame: str, target: Array, target_rate: Array, target_acceleration: Array
) -> NativeRows:
    """Return what the native core needs of a rotation's residual and drift: it adds both motions.

    See :func:`orientation_residual` and :func:`orientation_drift`.
    """
    numbers = target.ravel(), target_rate, target_acceleration
    return NativeRows(Kind.ORIENTATION, frame, (0, 1, 2), np.zeros(3), np.zeros(3), numbers)


def homogeneous(position: Array, rotation: Array) -> Array:
    """Return the (4, 4) matrix of a position and a rotation."""
    matrix = np.eye(4)
    matrix[:3, 3], matrix[:3, :3] = position, rotation
    return matrix


def placement_of(what: str, matrix: ArrayLike) -> tuple[Array, Array]:
    """Return position (3,) and rotation (3, 3) of a homogeneous matrix (4, 4)."""
    values = finite_array(what, matrix, (4, 4))
    if np.abs(values[3] - (0.0, 0.0, 0.0, 1.0)).max() > 1e-9:
        raise InvalidInputError(f"{what}: the last row of a homogeneous matrix is 0 0 0 1")
    return values[:3, 3], values[:3, :3]


def orientation_residual(
    snapshot: Snapshot, frame: str, target: Array, target_rate: Array
) -> Residual:
    """Return the error log(R*' R) (3,) and its first derivative.

    R*' R turns at R'(w - w*) in its own axes.
    """
    R = snapshot.rotation(frame)
    relative = target.T @ R
    to_error = log_jacobian(relative) @ R.T  # world angular velocity -> rate of the error
    jacobian = to_error @ snapshot.jacobian(frame)[3:]
    return Residual(log_rotation(relative), jacobian, -(to_error @ target_rate))


def orientation_drift(
    snapshot: Snapshot, frame: str, target: Array, target_rate: Array, target_acceleration: Array
) -> Array:
    """Return the second derivative (3,) of log(R*' R) at zero acceleration of v.

    d/dt R'(w - w*) = R'(w' - w*' + w x w*).
    """
    R = snapshot.rotation(frame)
    relative = target.T @ R
    w = snapshot.jacobian(frame)[3:] @ snapshot.v
    alpha = snapshot.drift(frame)[3:] - target_acceleration + skew(w) @ target_rate
    return log_drift(relative, R.T @ (w - target_rate), R.T @ alpha)


def log_drift(relative: Array, w: Array, alpha: Array) -> Array:
    """Return d2/dt2 log(Q) (3,) of a rotation Q that turns at ``w`` and ``alpha`` in its axes."""
    J = log_jacobian(relative)
    return J @ alpha + log_jacobian_rate(log_rotation(relative), J @ w) @ w
