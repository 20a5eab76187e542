"""Pose of one frame of the robot as seen from another, such as a hand in the torso."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.laws import Residual
from wbc.robot import Robot, Snapshot
from wbc.rotations import log_jacobian, log_rotation
from wbc.spatial import skew
from wbc.tasks.frame import TURNS, log_drift
from wbc.tasks.keywords import Gains
from wbc.tasks.placement import PlacementTask
from wbc.tasks.point import AXES
from wbc.validate import Array, names_of

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression, SymbolicPosture


class RelativePoseTask(PlacementTask):
    """Bring ``frame`` to a position and a rotation as seen from the frame ``relative_to``.

    With R, p the placements in the world the error is R_a' (p_b - p_a) minus the wanted position
    [m], then log(R_t' R_a' R_b) [rad]. Held exactly, as a contact, it makes two hands carry one
    object.

    Parameters
    ----------
    frame, relative_to:
        Two frames of the robot.
    position, rotation:
        (3,) [m] and (3, 3), in axes of ``relative_to``; so are the rates of a target that moves,
        as seen from there.
    components:
        Which of ``x y z rx ry rz`` are controlled.

    Raises
    ------
    UnknownNameError
        No such frame or component.
    InvalidInputError
        The two frames are one, or the rotation is none.
    """

    frame: str
    relative_to: str

    def __init__(
        self,
        robot: Robot,
        frame: str,
        relative_to: str,
        position: ArrayLike,
        rotation: ArrayLike,
        *,
        components: Sequence[str] = AXES + TURNS,
        name: str | None = None,
        **law: Unpack[Gains],
    ) -> None:
        components = names_of("relative pose task, components", components)
        for component in components:
            if component not in AXES + TURNS:
                raise UnknownNameError("component of a pose", component, AXES + TURNS)
        super().__init__(robot, name or f"{frame} in {relative_to}", components, **law)
        if robot.frame_id(frame) == robot.frame_id(relative_to):
            raise InvalidInputError(f"{self}: {frame!r} never moves as seen from itself")
        self.frame, self.relative_to = frame, relative_to
        self._selected = np.array([(AXES + TURNS).index(one) for one in components])
        self.set_target(position, rotation)

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return relative position minus target [m] above log(R_t' R_a' R_b) [rad]."""
        Ra, Rb = snapshot.rotation(self.relative_to), snapshot.rotation(self.frame)
        Ja, Jb = snapshot.jacobian(self.relative_to), snapshot.jacobian(self.frame)
        arm = snapshot.position(self.frame) - snapshot.position(self.relative_to)
        relative = self.rotation.T @ Ra.T @ Rb
        error = np.concatenate((Ra.T @ arm - self.position, log_rotation(relative)))
        linear = Ra.T @ (Jb[:3] - Ja[:3] + skew(arm) @ Ja[3:])
        to_error = log_jacobian(relative) @ Rb.T
        jacobian = np.concatenate((linear, to_error @ (Jb[3:] - Ja[3:])))
        turning = to_error @ (Ra @ self.target_rate[3:])
        bias = -np.concatenate((self.target_rate[:3], turning))
        chosen = self._selected
        return Residual(error[chosen], jacobian[chosen], bias[chosen])

    @property
    def units(self) -> tuple[str, ...]:
        """Metres, then radians."""
        return tuple("m" if row in AXES else "rad" for row in self.rows)

    def drift(self, snapshot: Snapshot) -> Array:
        """Return the error's second derivative at v' = 0, the target's motion in it."""
        Ra, Rb = snapshot.rotation(self.relative_to), snapshot.rotation(self.frame)
        Ja, Jb = snapshot.jacobian(self.relative_to), snapshot.jacobian(self.frame)
        arm = snapshot.position(self.frame) - snapshot.position(self.relative_to)
        Va, Vb = Ja @ snapshot.v, Jb @ snapshot.v
        Aa, Ab = snapshot.drift(self.relative_to), snapshot.drift(self.frame)
        w, slide = Va[3:], Vb[:3] - Va[:3]
        linear = Ra.T @ (
            Ab[:3]
            - Aa[:3]
            - np.cross(Aa[3:], arm)
            - 2.0 * np.cross(w, slide)
            + np.cross(w, np.cross(w, arm))
        )
        # The target's angular velocity and acceleration in the world: it rides on relative_to.
        spin = Ra @ self.target_rate[3:]
        turning = w + spin
        speeding = Aa[3:] + Ra @ self.target_acceleration[3:] + np.cross(w, spin)
        relative = self.rotation.T @ Ra.T @ Rb
        spin_up = Ab[3:] - speeding + np.cross(Vb[3:], turning)
        angular = log_drift(relative, Rb.T @ (Vb[3:] - turning), Rb.T @ spin_up)
        linear = linear - self.target_acceleration[:3]
        return np.concatenate((linear, angular))[self._selected]

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return the error as an expression of the posture."""
        from wbc.robot.placement import rotation_log

        R = posture.rotation(self.relative_to)
        arm = posture.position(self.frame) - posture.position(self.relative_to)
        relative: Any = self.rotation.T @ R.T @ posture.rotation(self.frame)
        rows: Any = np.eye(6)[self._selected]
        return rows[:, :3] @ (R.T @ arm - self.position) + rows[:, 3:] @ rotation_log(relative)
