"""Centre of mass position."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import UnknownNameError
from wbc.robot import Robot, Snapshot
from wbc.tasks.task import Residual, Task
from wbc.validate import Array

AXES = ("x", "y", "z")


class ComTask(Task):
    """Bring the CoM to ``target`` (paper eqs. 28, 31).

    Parameters
    ----------
    target:
        (3,) world position [m]; entries of axes that are not controlled are ignored.
    axes:
        Which of ``x``, ``y``, ``z`` (world) are controlled.
    """

    def __init__(
        self,
        robot: Robot,
        target: ArrayLike,
        *,
        axes: Sequence[str] = AXES,
        name: str = "com",
        weight: ArrayLike = 1.0,
        gain: float = 0.5,
        lm_damping: float = 0.0,
    ) -> None:
        super().__init__(robot, name, axes, weight=weight, gain=gain, lm_damping=lm_damping)
        self._selected = axis_indices(axes)
        self.set_target(target)

    def set_target(
        self, target: ArrayLike, rate: ArrayLike = (0, 0, 0), acceleration: ArrayLike = (0, 0, 0)
    ) -> None:
        """Set target position [m] and, for a moving target, its velocity and acceleration."""
        self.target = self._target(target, (3,))
        self.target_rate = self._target(rate, (3,), "target rate")
        self.target_acceleration = self._target(acceleration, (3,), "target acceleration")

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return CoM minus target [m]."""
        rows = self._selected
        error = (snapshot.com - self.target)[rows]
        return Residual(error, snapshot.com_jacobian[rows], -self.target_rate[rows])

    def drift(self, snapshot: Snapshot) -> Array:
        """Return the CoM's acceleration at zero acceleration of v [m/s^2]."""
        return (snapshot.com_drift - self.target_acceleration)[self._selected]


def axis_indices(axes: Sequence[str]) -> slice | np.ndarray:
    """Return the index of the named axes; a slice (no copy) when all three are wanted in order."""
    for axis in axes:
        if axis not in AXES:
            raise UnknownNameError("axis", axis, AXES)
    if tuple(axes) == AXES:
        return slice(0, 3)
    return np.array([AXES.index(axis) for axis in axes])
