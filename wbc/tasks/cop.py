"""Centre of pressure: where the contact forces have no moment about horizontal axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, shown
from wbc.native.rows import Kind, NativeRows
from wbc.robot import Robot
from wbc.tasks.force_task import ForceTask
from wbc.validate import Array, read_only, real_array


class CopTask(ForceTask):
    """Bring the centre of pressure to ``target``, of one contact or of all.

    The CoP is a ratio of unknowns, but the moment about a target point is linear in them, and zero
    if the CoP is there. So the error is that moment [N m]: distance times load.

    Parameters
    ----------
    target:
        The target point. For all contacts: (3,) in the world [m], or (2,) at the mean height of the
        contacts' frames. For one contact: (2,) in the plane of its frame [m], from its origin.
    frame:
        Frame of the contact; None for all.
    """

    frame: str | None
    _about: Array
    _fixed = ForceTask._fixed | {"frame": "make another task"}  # what its target is in

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
        """Set the target point."""
        point = target if isinstance(target, np.ndarray) else real_array(f"{self}, target", target)
        size = point.size
        if size != 2 and (size != 3 or self.frame is not None):
            wanted = "(2,) or (3,)" if self.frame is None else "(2,), in the frame's plane"
            raise InvalidInputError(
                f"{self}, target: expected a point {wanted}, got {shown(target)}"
            )
        goal = self._target(point, (size,))
        # The point, and whether its height is the contacts'.
        about = np.array((*goal.tolist(), *((0.0,) if size == 3 else (0.0, 1.0))))
        self._follow(goal, read_only(about))

    def _follow(self, goal: Array, about: Array) -> None:
        """Set a target that the package made itself, of read-only arrays: not checked or copied."""
        self._assign(_goal=goal, _about=about)

    def native(self) -> tuple[NativeRows, ...]:
        """Return the moment about the target point: horizontal, or in the frame's plane."""
        still = self._zeros()
        rows = NativeRows(Kind.COP, self.frame, (0, 1), still, still, (self._about,))
        return (rows._replace(moving=("", "", "_about")),)
