"""Pose of one frame of the robot as seen from another, such as a hand in the torso."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from wbc.kinds import one_of
from wbc.native.rows import Kind, NativeRows
from wbc.robot import Robot
from wbc.tasks.core_task import CoreTask, check_frame
from wbc.tasks.frame import POSE_UNITS, TURNS
from wbc.tasks.keywords import Gains
from wbc.tasks.placement import PlacementTask
from wbc.tasks.point import AXES
from wbc.validate import names_of

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression, SymbolicPosture


class RelativePoseTask(PlacementTask, CoreTask):
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

    _units = POSE_UNITS

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
            one_of("component of a pose", component, AXES + TURNS)
        given = f"{frame} in {relative_to}" if name is None else name
        super().__init__(robot, given, components, **law)
        self.frame, self.relative_to = frame, relative_to
        self._chosen = tuple((AXES + TURNS).index(one) for one in components)
        self.set_target(position, rotation)

    def _set_attribute(self, name: str, value: Any) -> None:
        if name in ("frame", "relative_to"):
            other = "frame" if name == "relative_to" else "relative_to"
            check_frame(self, name, value, other=other, same="never moves as seen from itself")
        super()._set_attribute(name, value)

    def native(self) -> tuple[NativeRows, ...]:
        """Return the chosen rows."""
        still, moves = self._zeros(), (self.target_rate, self.target_acceleration)
        numbers = self.position, self.rotation.ravel(), *moves
        rows = NativeRows(Kind.RELATIVE, self.frame, self._chosen, still, still, numbers)
        moving = "", "", "position", "rotation", "target_rate", "target_acceleration"
        return (rows._replace(moving=moving, other=self.relative_to),)

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return the error as an expression of the posture."""
        from wbc.placement import rotation_log

        R = posture.rotation(self.relative_to)
        arm = posture.position(self.frame) - posture.position(self.relative_to)
        relative: Any = self.rotation.T @ R.T @ posture.rotation(self.frame)
        rows: Any = np.eye(6)[list(self._chosen)]
        return rows[:, :3] @ (R.T @ arm - self.position) + rows[:, 3:] @ rotation_log(relative)
