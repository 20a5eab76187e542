"""Centre of mass position."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Unpack

from numpy.typing import ArrayLike

from wbc.robot import Robot, Snapshot
from wbc.tasks.point import AXES, PointTask
from wbc.tasks.task import Law
from wbc.validate import Array

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression, SymbolicPosture


class ComTask(PointTask):
    """Bring the CoM to ``target`` (paper eqs. 28, 31).

    Parameters
    ----------
    target:
        (3,) world position [m]; entries of axes that are not controlled are ignored.
    axes:
        Which of ``x``, ``y``, ``z`` (world) are controlled.
    law:
        ``weight`` [1/(m/s)], ``gain`` and ``lm_damping``; see :class:`~wbc.tasks.task.Task`.
    """

    def __init__(
        self,
        robot: Robot,
        target: ArrayLike,
        *,
        axes: Sequence[str] = AXES,
        name: str = "com",
        **law: Unpack[Law],
    ) -> None:
        super().__init__(robot, name, target, axes, **law)

    def _place(self, snapshot: Snapshot) -> Array:
        return snapshot.com

    def _jacobian(self, snapshot: Snapshot) -> Array:
        return snapshot.com_jacobian

    def _acceleration(self, snapshot: Snapshot) -> Array:
        return snapshot.com_drift

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return CoM minus target [m]."""
        return (posture.com - self.target)[self._selected]
