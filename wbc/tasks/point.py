"""A point of the robot brought to a place, which may move: its CoM, or a frame's origin."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import ArrayLike

from wbc.kinds import one_of
from wbc.laws import columns_of
from wbc.native.rows import Kind, NativeRows
from wbc.robot import Robot, Snapshot
from wbc.tasks.core_task import CoreTask
from wbc.tasks.keywords import Gains
from wbc.tasks.task import Aim
from wbc.validate import Array, names_of, read_only

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression, SymbolicPosture

AXES = ("x", "y", "z")


class PointTask(CoreTask):
    """Bring a point to ``target`` along some of the world's axes; the error is in metres."""

    _units = "m"

    def __init__(
        self, robot: Robot, name: str, target: ArrayLike, axes: Sequence[str], **law: Unpack[Gains]
    ) -> None:
        axes = names_of("axes of a point", axes)
        super().__init__(robot, name, axes, **law)
        for axis in axes:
            one_of("axis", axis, AXES)
        self._entries = tuple(AXES.index(axis) for axis in axes)
        self._selected = columns_of(self._entries)
        self._mass = read_only(np.array((robot.mass,)))
        self.set_target(target)

    def set_target(
        self,
        target: ArrayLike,
        rate: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> None:
        """Set target position (3,) [m] and, for a moving target, its velocity and acceleration."""
        self._follow(self._target(target, (3,)), *self._rates((3,), rate, acceleration))

    def _follow(self, target: Array, rate: Array, acceleration: Array) -> None:
        """Set a target that the package made itself, of read-only arrays: not checked or copied."""
        if self._rests(rate, acceleration):
            self._assign(_goal=target)
            return
        rows = self._selected
        self._assign(
            _goal=target,
            target_rate=rate,
            target_acceleration=acceleration,
            _bias=self._negative(rate, rows),
            _drift=self._negative(acceleration, rows),
        )

    def aim(self, snapshot: Snapshot) -> Aim:
        """Return the point and its target; where an axis is not controlled both agree."""
        point = self._point(snapshot)
        wanted = point.copy()
        wanted[self._selected] = self._goal[self._selected]
        return Aim(point, wanted)

    def _native_rows(self, frame: str | None) -> tuple[NativeRows, ...]:
        """Return what the native core needs of a point: the origin of a frame, None for the CoM."""
        rates, numbers = (self._bias, self._drift), (self._goal, self._mass)
        moving = "_bias", "_drift", "_goal"
        return (NativeRows(Kind.POINT, frame, self._entries, *rates, numbers, moving=moving),)

    @abstractmethod
    def _point(self, snapshot: Snapshot) -> Array:
        """Return where the point is (3,), world axes."""


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
        **law: Unpack[Gains],
    ) -> None:
        super().__init__(robot, name, target, axes, **law)

    def _point(self, snapshot: Snapshot) -> Array:
        return snapshot.com

    def native(self) -> tuple[NativeRows, ...]:
        """Return the rows of the CoM."""
        return self._native_rows(None)

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return CoM minus target [m]."""
        return (posture.com - self.target)[self._selected]


class PositionTask(PointTask):
    """Bring the origin of ``frame`` to ``target`` (3,) [m], world axes.

    ``weight`` is in [1/(m/s)]; see :class:`~wbc.tasks.task.Task` for it, ``gain`` and
    ``lm_damping``, here and in the other tasks of frames.
    """

    frame: str

    def __init__(
        self,
        robot: Robot,
        frame: str,
        target: ArrayLike,
        *,
        axes: Sequence[str] = AXES,
        name: str | None = None,
        **law: Unpack[Gains],
    ) -> None:
        super().__init__(robot, f"{frame} position" if name is None else name, target, axes, **law)
        self.frame = frame

    def _point(self, snapshot: Snapshot) -> Array:
        return snapshot.position(self.frame)

    def native(self) -> tuple[NativeRows, ...]:
        """Return the rows of the frame's origin."""
        return self._native_rows(self.frame)

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return position minus target [m]."""
        return (posture.position(self.frame) - self.target)[self._selected]
