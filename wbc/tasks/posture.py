"""Joint positions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, shown
from wbc.native.rows import Kind, NativeRows
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.model import check_robot
from wbc.tasks.core_task import CoreTask
from wbc.tasks.keywords import LawKeywords
from wbc.tasks.weights import joint_factors
from wbc.validate import Array, finite_number, read_only

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression, SymbolicPosture


class PostureTask(CoreTask):
    """Bring the joints to those of a configuration, the shorter way round if they are continuous.

    Parameters
    ----------
    target:
        Configuration (nq,); its base part is ignored.
    weight:
        [1/(rad/s)] or [1/(m/s)], the same for all joints.
    joints:
        Factors on ``weight`` by joint name or shell pattern (``{"left_*": 10, "*knee*": 0}``);
        later entries win. If given, joints that no entry matches keep the factor 1. A joint of
        factor 0 is left out of the task.
    """

    def __init__(
        self,
        robot: Robot,
        target: ArrayLike,
        *,
        joints: Mapping[str, float] | None = None,
        name: str = "posture",
        weight: float = 1.0,
        priority: int = 0,
        **law: Unpack[LawKeywords],
    ) -> None:
        check_robot(type(self).__name__, robot)
        factors = joint_factors(robot, joints, name)[BASE_NV:]
        chosen = np.flatnonzero(factors)
        if chosen.size == 0:
            why = "every joint has weight 0" if factors.size else f"{robot.name} has no joint"
            raise InvalidInputError(f"task {name!r}: {why}; leave the task out")
        names = [robot.joint_names[k] for k in chosen]
        if isinstance(weight, Mapping | list | tuple) or np.ndim(weight):
            raise InvalidInputError(
                f"task {name!r}, weight: expected one number for all joints, got {shown(weight)};"
                ' joints={"*knee*": 10} weighs them apart'
            )
        weights = finite_number(f"task {name!r}, weight", weight, least=0.0) * factors[chosen]
        super().__init__(robot, name, names, weight=weights, priority=priority, **law)
        self._positions: Array  # wanted, of all joints
        self._wanted: Array  # of those that the task is about
        every = chosen.size == factors.size
        self._joints = slice(None) if every else chosen
        self._columns = slice(BASE_NV, robot.nv) if every else BASE_NV + chosen
        self.set_target(target)

    def set_target(
        self,
        target: ArrayLike,
        rate: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> None:
        """Set the wanted configuration (nq,) and, if it moves, its rate and acceleration (nv,).

        Entries of the base are ignored.
        """
        goal = read_only(self.robot.check_configuration(target))
        if self._set_rates((self.robot.nv,), rate, acceleration):
            bias = self._negative(self.target_rate, self._columns)
            drift = self._negative(self.target_acceleration, self._columns)
            self._assign(_bias=bias, _drift=drift)
        positions = self.robot.limits.joint_positions(goal)
        self._assign(_goal=goal, _positions=positions, _wanted=positions[self._joints])

    def native(self) -> tuple[NativeRows, ...]:
        """Return one row for each joint."""
        joints = tuple(np.arange(self._positions.size)[self._joints].tolist())
        rates, numbers = (self._bias, self._drift), (self._wanted,)
        moving = "_bias", "_drift", "_wanted"
        return (NativeRows(Kind.JOINTS, None, joints, *rates, numbers, moving=moving),)

    @property
    def units(self) -> tuple[str, ...]:
        """Radians, or metres of prismatic joints."""
        model = self.robot.model
        kinds = (model.joints[model.getJointId(name)].shortname() for name in self.rows)
        return tuple("m" if kind.startswith("JointModelP") else "rad" for kind in kinds)

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return joint positions minus target [rad or m], the shorter way round if continuous."""
        return posture.joint_errors(self._positions)[self._joints]
