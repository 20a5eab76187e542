"""A target of position and rotation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wbc.attributes import ArrayAttribute
from wbc.errors import InvalidInputError
from wbc.rotations import check_rotation
from wbc.tasks.task import Task
from wbc.validate import Array, finite_array, read_only


class PlacementTask(Task):
    """A task with a position and a rotation as target; assigning one keeps the other, at rest."""

    position: ArrayAttribute  # target (3,) [m], read-only
    rotation: ArrayAttribute  # target (3, 3), read-only
    _turn_rate: Array  # (3,) angular velocity of the target
    _turn_acceleration: Array  # (3,)

    def _set_attribute(self, name: str, value: Any) -> None:
        if name in ("position", "rotation"):
            self.set_target(**{"position": self.position, "rotation": self.rotation, name: value})
        else:
            super()._set_attribute(name, value)

    def set_target(
        self,
        position: ArrayLike,
        rotation: ArrayLike | None = None,
        rate: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> None:
        """Set the target position (3,) [m] and rotation (3, 3), in the task's axes.

        Parameters
        ----------
        rate, acceleration:
            For a moving target: velocity [m/s] and angular velocity [rad/s] (6,), and the
            derivatives of both, in the same axes.
        """
        if rotation is None:
            raise InvalidInputError(
                f"{self}: a position and a rotation are expected; of a pose T give T.translation,"
                f" T.rotation, or assign target = T"
            )
        place = self._target(position, (3,), "position")
        turn = self._target(rotation, (3, 3), "rotation")
        check_rotation(self, turn, "rotation")
        self._follow(place, turn, *self._rates((6,), rate, acceleration))

    def _follow(self, position: Array, rotation: Array, rate: Array, acceleration: Array) -> None:
        """Set a target that the package made itself, of read-only arrays: not checked or copied."""
        if self._rests(rate, acceleration):
            self._assign(position=position, rotation=rotation)
            return
        self._assign(
            position=position,
            rotation=rotation,
            target_rate=rate,
            target_acceleration=acceleration,
            _bias=read_only(-rate[:3]),
            _turn_rate=rate[3:],
            _drift=read_only(-acceleration[:3]),
            _turn_acceleration=acceleration[3:],
        )

    @property
    def target(self) -> Array:
        """Position and rotation as one homogeneous matrix (4, 4); may be assigned."""
        return read_only(homogeneous(self.position, self.rotation))

    @target.setter
    def target(self, value: ArrayLike) -> None:
        self.set_target(*placement_of(f"{self}, target", value))


def homogeneous(position: Array, rotation: Array) -> Array:
    """Return the (4, 4) matrix of a position and a rotation."""
    matrix = np.eye(4)
    matrix[:3, 3], matrix[:3, :3] = position, rotation
    return matrix


def placement_of(what: str, matrix: ArrayLike) -> tuple[Array, Array]:
    """Return position (3,) and rotation (3, 3) of a homogeneous matrix (4, 4)."""
    values = finite_array(what, matrix, (4, 4))
    if np.abs(values[3] - (0.0, 0.0, 0.0, 1.0)).max() > 1e-9:
        raise InvalidInputError(f"{what}: the last row of a homogeneous matrix is 0 0 0 1")
    return values[:3, 3], values[:3, :3]
