"""Contact forces: a wanted wrench, a share of the load, and no sudden changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.kinds import one_of
from wbc.robot import Robot
from wbc.robot.model import check_robot
from wbc.tasks.force_task import WRENCH, Affine, Dynamics, ForceTask
from wbc.validate import by_name, names_of


class ContactForceTask(ForceTask):
    """Bring a contact's wrench to ``target``.

    While the frame is not in contact its wrench is zero, and the error is minus the target.

    Parameters
    ----------
    frame:
        Of the contact.
    target:
        (6,) force [N] then moment [N m] on the robot at the frame's origin, world axes.
    components:
        Which of ``fx fy fz mx my mz``.
    name:
        ``"<frame> force"`` unless given.
    """

    frame: str

    def __init__(
        self,
        robot: Robot,
        frame: str,
        target: ArrayLike = (0, 0, 0, 0, 0, 0),
        *,
        components: Sequence[str] = WRENCH,
        name: str | None = None,
        weight: ArrayLike = 1.0,
        priority: int = 0,
    ) -> None:
        components = names_of("contact force task, components", components)
        for component in components:
            one_of("wrench component", component, WRENCH)
        name = f"{frame} force" if name is None else name
        super().__init__(robot, name, components, weight=weight, priority=priority)
        self.frame = frame
        self._selected = [WRENCH.index(component) for component in components]
        self.set_target(target)

    def _set_attribute(self, name: str, value: Any) -> None:
        if name == "frame":
            value = self._contact_frame(value)
        super()._set_attribute(name, value)

    def set_target(self, target: ArrayLike) -> None:
        """Set the wanted wrench (6,) [N, N m]."""
        self._goal = self._target(target, (6,))

    def expression(self, dynamics: Dynamics) -> Affine:
        """Return wrench minus target."""
        rows = self._selected
        return Affine(dynamics.wrench(self.frame)[rows], -self.target[rows])


class LoadShareTask(ForceTask):
    """Bring each contact's share of the vertical force of all named contacts to a target.

    The sum is left to the motion. Frames that are not in contact now are left out, and the others
    share in proportion.

    Parameters
    ----------
    shares:
        By frame, not negative, in proportion: ``{"left_sole": 2, "right_sole": 1}``.
    """

    frames: tuple[str, ...]
    _fixed = ForceTask._fixed | {"frames": "make another task"}

    def __init__(
        self,
        robot: Robot,
        shares: Mapping[str, float],
        *,
        name: str = "load share",
        weight: ArrayLike = 1.0,
        priority: int = 0,
    ) -> None:
        frames = tuple(by_name(f"task {name!r}, shares", shares))
        super().__init__(
            robot, name, [f"{frame} fz" for frame in frames], weight=weight, priority=priority
        )
        self.frames = tuple(self._contact_frame(frame) for frame in frames)
        self.set_target(list(shares.values()))

    def set_target(self, target: ArrayLike) -> None:
        """Set the shares, in the order of the frames."""
        shares = self._target(target, (len(self.rows),))
        if (shares < 0.0).any() or not shares.any():
            raise InvalidInputError(
                f"{self}: shares must not be negative, nor all be 0, got {shares.tolist()}"
            )
        self._goal = shares

    def expression(self, dynamics: Dynamics) -> Affine:
        """Return vertical force minus the share of the sum."""
        matrix = np.zeros((len(self.rows), dynamics.size))
        here = [k for k, frame in enumerate(self.frames) if frame in dynamics.contacts]
        shares = self.target[here]
        if shares.any():
            for k in here:
                matrix[k] = dynamics.wrench(self.frames[k])[2]
            matrix[here] -= np.outer(shares / shares.sum(), matrix[here].sum(axis=0))
        return Affine(matrix, np.zeros(len(self.rows)))


class ForceRateTask(ForceTask):
    """Penalise changes of contact wrenches from the last tick.

    Without effect in a controller's first tick. A new contact's last wrench is zero.

    Parameters
    ----------
    frames:
        Of the contacts; left out, the soles of the robot's feet.
    weight:
        On the change per tick, see :class:`~wbc.tasks.force_task.ForceTask`.
    """

    frames: tuple[str, ...]
    _fixed = ForceTask._fixed | {"frames": "make another task"}

    def __init__(
        self,
        robot: Robot,
        frames: Sequence[str] | None = None,
        *,
        name: str = "force rate",
        weight: ArrayLike = 0.1,
        priority: int = 0,
    ) -> None:
        check_robot(type(self).__name__, robot)
        if frames is None:
            frames = [foot.frame for foot in robot.feet.values()]
        frames = names_of(f"task {name!r}, frames", frames)
        rows = [f"{frame} {row}" for frame in frames for row in WRENCH]
        super().__init__(robot, name, rows, weight=weight, priority=priority)
        self.frames = tuple(self._contact_frame(frame) for frame in frames)

    def expression(self, dynamics: Dynamics) -> Affine:
        """Return wrenches minus those of the last tick."""
        matrix, constant = np.zeros((len(self.rows), dynamics.size)), np.zeros(len(self.rows))
        for k, frame in enumerate(self.frames):
            last = dynamics.last_wrench(frame)
            if last is not None and frame in dynamics.contacts:
                matrix[6 * k : 6 * k + 6] = dynamics.wrench(frame)
                constant[6 * k : 6 * k + 6] = -last
        return Affine(matrix, constant)
