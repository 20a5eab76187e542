"""Centre of pressure: where the contact forces have no moment about horizontal axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, shown
from wbc.robot import Robot
from wbc.spatial import skew
from wbc.tasks.force_task import Affine, Dynamics, ForceTask
from wbc.validate import Array, real_array


class CopTask(ForceTask):
    """Bring the centre of pressure to ``target``, of one contact or of all.

    A CoP is a ratio of unknowns; for a wanted point the moment about it is linear in them, and zero
    where the CoP is there. So the error is that moment [N m]: the distance, times the load.

    Parameters
    ----------
    target:
        The wanted point. Of all contacts: (3,) in the world [m], or (2,) at the mean height of the
        contacts' frames. Of one contact: (2,) in the plane of its frame [m], from its origin.
    frame:
        Of the contact; None for all.
    """

    frame: str | None

    def __init__(
        self,
        robot: Robot,
        target: ArrayLike,
        *,
        frame: str | None = None,
        name: str | None = None,
        weight: ArrayLike = 1.0,
        priority: int = 0,
    ) -> None:
        if name is None:
            name = "cop" if frame is None else f"{frame} cop"
        super().__init__(robot, name, ("mx", "my"), weight=weight, priority=priority)
        self.frame = None if frame is None else self._contact_frame(frame)
        self.set_target(target)

    def set_target(self, target: ArrayLike) -> None:
        """Set the wanted point."""
        point = target if isinstance(target, np.ndarray) else real_array(f"{self}, target", target)
        size = point.size
        if size != 2 and (size != 3 or self.frame is not None):
            wanted = "(2,) or (3,)" if self.frame is None else "(2,), in the frame's plane"
            raise InvalidInputError(
                f"{self}, target: expected a point {wanted}, got {shown(target)}"
            )
        self._goal = self._target(point, (size,))

    def expression(self, dynamics: Dynamics) -> Affine:
        """Return the moment about the wanted point: horizontal, or in the frame's plane."""
        matrix, snapshot = np.zeros((3, dynamics.size)), dynamics.snapshot
        if self.frame is None:
            point = self._point(dynamics)
            for frame in dynamics.contacts:
                matrix += moment(dynamics.wrench(frame), snapshot.position(frame) - point)
        else:
            R = snapshot.rotation(self.frame)
            matrix = R.T @ moment(dynamics.wrench(self.frame), -R[:, :2] @ self.target)
        return Affine(matrix[:2], np.zeros(2))

    def _point(self, dynamics: Dynamics) -> Array:
        """Return the wanted point (3,) in the world."""
        if self.target.size == 3:
            return self.target
        heights = [dynamics.snapshot.position(frame)[2] for frame in dynamics.contacts]
        return np.append(self.target, np.mean(heights) if heights else 0.0)


def moment(wrench: Array, lever: Array) -> Array:
    """Return the moment (3, n) of a wrench (6, n) about a point, ``lever`` (3,) from there."""
    return wrench[3:] + skew(lever) @ wrench[:3]
