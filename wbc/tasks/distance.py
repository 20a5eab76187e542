"""Distance between the origins of two frames, such as two hands."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from wbc.laws import Residual
from wbc.robot import Robot, Snapshot
from wbc.tasks.core_task import check_frame
from wbc.tasks.keywords import Gains
from wbc.tasks.task import Task
from wbc.validate import Array, finite_number, read_only

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression, SymbolicPosture

# Nearer than this [m] the direction from one to the other is undefined: z is used.
LEAST_DISTANCE = 1e-9
_UP = read_only(np.array((0.0, 0.0, 1.0)))


class DistanceTask(Task):
    """Bring the origins of ``frame`` and ``other`` to a distance, in any direction.

    Parameters
    ----------
    frame, other:
        Two frames of the robot.
    target:
        Wanted distance [m], >= 0.

    Raises
    ------
    UnknownNameError
        No such frame.
    InvalidInputError
        The two frames are one, or the distance is negative.
    """

    frame: str
    other: str

    _units = "m"

    def __init__(
        self,
        robot: Robot,
        frame: str,
        other: str,
        target: float,
        *,
        name: str | None = None,
        **law: Unpack[Gains],
    ) -> None:
        own = f"{frame} to {other}" if name is None else name
        super().__init__(robot, own, ("distance",), **law)
        self.frame, self.other = frame, other
        self.set_target(target)

    def _set_attribute(self, name: str, value: Any) -> None:
        if name in ("frame", "other"):
            other = "frame" if name == "other" else "other"
            check_frame(self, name, value, other=other, same="has no distance from itself")
        super()._set_attribute(name, value)

    def set_target(
        self, target: float, rate: float | None = None, acceleration: float | None = None
    ) -> None:
        """Set the wanted distance [m] and, if it changes, its rate and acceleration."""
        wanted = finite_number(f"{self}, target", target, least=0.0)
        rates = (None if one is None else [one] for one in (rate, acceleration))
        self._set_rates((1,), *rates)
        self._goal, self._bias = read_only(np.array(wanted)), read_only(-self.target_rate)

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return distance minus target [m]."""
        direction, distance, relative = self._line(snapshot)
        jacobian = (direction @ relative)[None]
        return Residual(np.array([distance]) - self._goal, jacobian, self._bias)

    def drift(self, snapshot: Snapshot) -> Array:
        """Return the distance's second derivative at v' = 0, less the target's [m/s^2]."""
        direction, distance, relative = self._line(snapshot)
        velocity = relative @ snapshot.v
        acceleration = snapshot.drift(self.frame)[:3] - snapshot.drift(self.other)[:3]
        along = float(direction @ velocity)
        across = float(velocity @ velocity) - along * along
        own = direction @ acceleration + across / max(distance, LEAST_DISTANCE)
        return own - self.target_acceleration

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return distance minus target [m]."""
        arm = posture.position(self.frame) - posture.position(self.other)
        # Smooth where the two meet; elsewhere off by less than 1e-12 m.
        return (arm.T @ arm + LEAST_DISTANCE**2) ** 0.5 - float(self._goal)

    def _line(self, snapshot: Snapshot) -> tuple[Array, float, Array]:
        """Return the direction (3,) from ``other`` to ``frame``, its length, and J (3, nv)."""
        arm = snapshot.position(self.frame) - snapshot.position(self.other)
        distance = math.sqrt(float(arm @ arm))
        relative = snapshot.jacobian(self.frame)[:3] - snapshot.jacobian(self.other)[:3]
        return (arm / distance if distance > LEAST_DISTANCE else _UP), distance, relative
