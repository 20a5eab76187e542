"""The limits of the safety layer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wbc.errors import InvalidInputError
from wbc.hardware.bus import rows_of
from wbc.robot import Robot
from wbc.robot.drives import motors_without_effort
from wbc.robot.limits import UNLIMITED
from wbc.validate import Array, check_fields, finite_array, names_of, read_only, set_fields


@dataclass(frozen=True, eq=False)
class SafetyLimits:
    """Limits on commands and readings.

    Attributes
    ----------
    names:
        Of the joints.
    lower, upper, velocity, effort:
        Of the joints (n,) [rad or m, per second, N m or N]; effort must be finite, and velocity
        above 0.
    kp, kd:
        Largest gains (n,).
    torque_rate:
        Largest change of the torque (n,) [N m/s].
    overrun:
        Largest measured distance of a joint beyond its range [rad or m].
    overspeed, overload:
        Largest measured velocities and torques, by their limits.
    warm, hot:
        Of the motors [degrees C].
    tilt:
        Of the IMU's axis ``up`` from the vertical [rad], at most pi.
    up:
        The axis of the IMU (3,) that is vertical when the robot stands; it is normalised.

    Raises
    ------
    InvalidInputError
        Limits of other sizes, NaN, reversed or negative.
    """

    names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    effort: Array
    kp: Array
    kd: Array
    torque_rate: Array
    overrun: float = 0.1
    overspeed: float = 1.2
    overload: float = 1.2
    warm: float = 80.0
    hot: float = 95.0
    tilt: float = 0.8
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        what = "safety limits, "
        check_fields(self, what, "overrun", "overspeed", "overload", "tilt", above=0.0)
        check_fields(self, what, "warm", "hot")
        n = len(names_of(f"{what}names", self.names))
        for name in ("effort", "kp", "kd", "torque_rate"):
            value = finite_array(f"{what}{name}", getattr(self, name), (n,))
            if not (value >= 0.0).all():
                raise InvalidInputError(f"{what}{name}: must not be negative")
            set_fields(self, **{name: read_only(value)})
        ranges = rows_of(n, self.lower, self.upper, self.velocity)
        if ranges is None or not (ranges[0] <= ranges[1]).all() or not (ranges[2] > 0.0).all():
            raise InvalidInputError(
                f"{what}lower, upper, velocity: expected {n} numbers each, lower at most upper,"
                " velocity above 0"
            )
        joints = zip(("lower", "upper", "velocity"), ranges, strict=True)
        set_fields(self, **{name: read_only(row) for name, row in joints})
        if self.hot < self.warm or self.tilt > np.pi:
            raise InvalidInputError(f"{what}hot, tilt: must be at least warm, and at most pi")
        up = finite_array(f"{what}up", self.up, (3,))
        if not up.any():
            raise InvalidInputError(f"{what}up: is 0; give the direction")
        set_fields(self, up=tuple((up / np.linalg.norm(up)).tolist()))

    @classmethod
    def of(cls, robot: Robot, kp: Array, kd: Array) -> SafetyLimits:
        """Return a robot's limits; the torque rate is from one bound to the other in 10 ms.

        A joint without a motor needs no effort limit: no torque acts there.

        Raises
        ------
        InvalidInputError
            Motors without an effort limit.
        """
        found, effort = robot.limits, np.minimum(robot.limits.effort, UNLIMITED)
        if without := motors_without_effort(found, robot.motorless):
            raise InvalidInputError(
                f"safety limits: {', '.join(without)} of {robot.name} have no effort limit; write"
                " it into the robot's file, or give Robot.load(..., effort={joint: N m})"
            )
        rate = 2.0 * effort / 0.010
        joints = found.lower, found.upper, found.velocity, effort
        return cls(robot.joint_names, *joints, kp, kd, rate)
