"""Joint torques: as small as can be, or near given ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.model import check_robot
from wbc.tasks.force_task import Affine, Dynamics, ForceTask
from wbc.validate import by_name, finite_number, names_of, real_array


class TorqueTask(ForceTask):
    """Bring joint torques to ``target``, by default to zero: the least torques that do the rest.

    Parameters
    ----------
    target:
        (nv - 6,) of all joints [N m or N], or by joint name or pattern (all others 0).
    joints:
        Names or patterns of the joints; all by default.
    weight:
        See :class:`~wbc.tasks.force_task.ForceTask`; light by default, beside tasks of motion.
    """

    _units = "N m or N"

    def __init__(
        self,
        robot: Robot,
        target: ArrayLike | Mapping[str, float] = 0.0,
        *,
        joints: Sequence[str] = ("*",),
        name: str = "torque",
        weight: ArrayLike = 0.03,
        priority: int = 0,
    ) -> None:
        check_robot(type(self).__name__, robot)
        patterns = names_of(f"task {name!r}, joints", joints)
        chosen = {k for pattern in patterns for k in robot.joint_indices(pattern)}
        self._joints = sorted(k - BASE_NV for k in chosen)
        rows = [robot.joint_names[k] for k in self._joints]
        super().__init__(robot, name, rows, weight=weight, priority=priority)
        self.set_target(target)

    def set_target(self, target: ArrayLike | Mapping[str, float]) -> None:
        """Set the wanted torques."""
        robot, size = self.robot, self.robot.nv - BASE_NV
        if isinstance(target, Mapping):
            wanted = np.zeros(size)
            for pattern, value in by_name(f"{self}, target", target).items():
                places = [k - BASE_NV for k in robot.joint_indices(pattern)]
                if not {*places} & {*self._joints}:
                    raise InvalidInputError(f"{self}, target: {pattern!r} is no joint of the task")
                wanted[places] = finite_number(f"{self}, target of {pattern!r}", value)
            target = wanted
        else:
            target = real_array(f"{self}, target", target)
            if not target.ndim:
                target = np.full(size, finite_number(f"{self}, target", target))
        self._goal = self._target(target, (size,))

    def expression(self, dynamics: Dynamics) -> Affine:
        """Return torques minus the wanted ones."""
        torque = dynamics.torque(self._joints)
        return Affine(torque.matrix, torque.constant - self.target[self._joints])
