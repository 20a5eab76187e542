"""Axis of a frame of the robot: a direction that it points in."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from wbc.attributes import ArrayAttribute
from wbc.errors import InvalidInputError
from wbc.native.rows import Kind, NativeRows
from wbc.robot import Robot
from wbc.tasks.core_task import CoreTask
from wbc.tasks.keywords import Gains
from wbc.tasks.point import AXES
from wbc.validate import Array, read_only

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression, SymbolicPosture


class AxisTask(CoreTask):
    """Point a body-fixed ``axis`` of ``frame`` along the world direction ``target``.

    The error is the difference of the two unit vectors (3 rows of rank 2): smooth everywhere, and
    the opposite direction is a saddle rather than a second rest point.
    """

    frame: str
    axis: ArrayAttribute  # unit, (3,), in the frame's axes
    _units = "1"  # of entries of a unit vector

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
        super().__init__(robot, f"{frame} axis" if name is None else name, AXES, **law)
        self.frame = frame
        self.axis = axis
        self.set_target(target)

    def _set_attribute(self, name: str, value: Any) -> None:
        if name == "axis":
            value = read_only(self._unit(value, "axis"))
        super()._set_attribute(name, value)

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
        turns = self._set_rates((3,), rate, acceleration)
        if rate is None and acceleration is None:  # at rest, as the rates then say
            self._assign(_goal=goal)
            if turns:
                self._assign(_bias=self.target_rate, _drift=self.target_acceleration)
            return
        n = float(np.linalg.norm(np.asarray(target, dtype=float)))
        # With d = n u: d' = n u' + n' u and d'' = n u'' + 2 n' u' + n'' u, where u'.u = 0.
        d1, d2 = self.target_rate, self.target_acceleration
        stretch = float(goal @ d1)
        u1 = (d1 - stretch * goal) / n
        u2 = (d2 - 2.0 * stretch * u1 - (float(u1 @ d1) + float(goal @ d2)) * goal) / n
        self._assign(_goal=goal, target_rate=read_only(u1), target_acceleration=read_only(u2))
        self._assign(_bias=read_only(-u1), _drift=read_only(-u2))

    def native(self) -> tuple[NativeRows, ...]:
        """Return what the native core needs of the axis and its target."""
        rates, numbers = (self._bias, self._drift), (self._goal, self.axis)
        moving = "_bias", "_drift", "_goal", ""
        return (NativeRows(Kind.POINTING, self.frame, (0, 1, 2), *rates, numbers, moving=moving),)

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return the axis minus the target, both unit vectors in world axes."""
        return posture.rotation(self.frame) @ self.axis - self.target

    def _unit(self, value: ArrayLike, what: str) -> Array:
        vector = self._target(value, (3,), what)
        length = math.hypot(*vector.tolist())
        if length < 1e-9:
            raise InvalidInputError(f"task {self.name!r}, {what}: a direction needs some length")
        return vector / length
