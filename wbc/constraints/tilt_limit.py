"""A trunk kept from tilting too far."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from wbc.constraints.limits import Limits
from wbc.constraints.margin import SKIN, BrakingParameters, Margin
from wbc.constraints.rows import Distances, SymbolicRows
from wbc.errors import InvalidInputError
from wbc.robot import Robot, Snapshot
from wbc.robot.model import check_snapshot
from wbc.validate import Array, Index, finite_number, finite_vector, read_only

if TYPE_CHECKING:
    from wbc.robot.symbolic import SymbolicPosture

# rad/s^2: what the ground lets a humanoid's trunk be braked by; of 10 to 40 what suited pushes.
TILT_BRAKING = 20.0
UPRIGHT = 1e-6  # sine of the tilt below which it has no direction


class TiltLimit(Margin):
    """Keep an axis of a frame within an angle of the vertical.

    Its row is about the angle itself [rad], so braking is in rad/s^2, and recovery in rad/s: a
    reaction mass that stops at its range. Beyond the angle the frame is brought back as a body is
    out of a margin.

    Parameters
    ----------
    frame:
        Such as the trunk's link.
    angle:
        The largest tilt, in (0, pi) [rad]; another one can be assigned.
    axis:
        (3,) what should point up, in the frame's axes; see :meth:`upright`.
    braking:
        By default with a deceleration of 20 rad/s^2.

    Raises
    ------
    UnknownNameError
        No such frame.
    InvalidInputError
        An angle out of range, or an axis of no length.
    """

    frame: str
    angle: float
    axis: Array
    unit = "rad"

    _fixed = dict.fromkeys(("frame", "axis"), "make another TiltLimit")

    def _set_attribute(self, name: str, value: Any) -> None:
        if name == "angle":
            value = finite_number(f"{self.name}, angle", value, above=0.0)
            if value >= np.pi:
                raise InvalidInputError(f"{self.name}, angle: must be below pi, got {value:g} rad")
        super()._set_attribute(name, value)

    def __init__(
        self,
        robot: Robot,
        frame: str,
        angle: float,
        *,
        axis: ArrayLike = (0.0, 0.0, 1.0),
        braking: BrakingParameters | None = None,
        limits: Limits | None = None,
    ) -> None:
        braking = BrakingParameters(TILT_BRAKING) if braking is None else braking
        super().__init__(robot, f"tilt of {frame}", braking, limits)
        robot.frame_id(frame)
        self.frame = frame
        self.angle = angle
        given = finite_vector(f"{self.name}, axis", axis, 3)
        length = float(np.linalg.norm(given))
        if length == 0.0:
            raise InvalidInputError(f"{self.name}, axis: has no length")
        self.axis = read_only(given / length)
        self._keys = np.arange(1)
        self._label = (f"{frame} tilt",)

    @classmethod
    def upright(
        cls,
        snapshot: Snapshot,
        frame: str,
        angle: float,
        *,
        braking: BrakingParameters | None = None,
    ) -> TiltLimit:
        """Return the constraint for what points up in ``snapshot``."""
        check_snapshot("TiltLimit.upright", snapshot)
        up = snapshot.rotation(frame)[2]
        return cls(snapshot.robot, frame, angle, axis=up, braking=braking)

    def distances(self, snapshot: Snapshot, keys: Index | None = None) -> Distances:
        """Return by how much the tilt may still grow [rad]."""
        up = snapshot.rotation(self.frame) @ self.axis
        sine = float(np.hypot(up[0], up[1]))
        clearance = np.array([self.angle - np.arctan2(sine, up[2]) - SKIN])
        jacobian = np.zeros((1, self.robot.nv))
        if sine > UPRIGHT:  # the tilt grows by turning about z cross up, which is horizontal
            about = np.array((-up[1], up[0])) / sine
            jacobian[0] = -about @ snapshot.jacobian(self.frame)[3:5]
        return Distances(self._keys, clearance, jacobian, None)

    def symbolic_rows(self, posture: SymbolicPosture) -> SymbolicRows:
        """Return one row: the cosine of the tilt."""
        value = posture.rotation(self.frame)[2, :] @ self.axis
        return SymbolicRows(value, np.array([np.cos(self.angle - SKIN)]), np.array([np.inf]))

    def labels(self, distances: Distances) -> tuple[str, ...]:
        """Return a label such as ``"torso_link tilt"``."""
        return self._label

    def curvature_bound(self, distances: Distances, step: Array) -> Array:
        """Bound how far the tilt ends beyond its linear prediction."""
        # The tilt is an angle between directions: about the horizontal axis it is linear, and about
        # axes across by phi it grows by 1/2 phi^2 cot(tilt), at most phi itself.
        turned = float(np.abs(step[3:]).sum())
        tilt = self.angle - SKIN - distances.clearance
        return np.minimum(turned, 0.5 * turned**2 / np.tan(np.clip(tilt, 1e-9, 0.5 * np.pi)))
