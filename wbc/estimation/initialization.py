"""The initialisation of an estimator: why there is no estimate yet, and checks of the first."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

import numpy as np

from wbc.errors import InvalidInputError
from wbc.estimation.estimate import Estimate
from wbc.estimation.measurement import ImuMount, Measurement
from wbc.robot import Robot
from wbc.validate import Array

WARN_AFTER = 4.0  # warn after this multiple of the usual number of messages
MAX_SOLE_TILT = 0.35  # rad: a larger tilt suggests a wrong mount
MAX_INTERVAL = 20.0  # periods between messages: longer ones suggest another unit of time


class Initialization:
    """Watches an estimator's messages until there is an estimate, and warns once."""

    def __init__(
        self, robot: Robot, imus: Sequence[ImuMount], standing_time: float, dt: float
    ) -> None:
        self._robot, self._imus, self._dt = robot, imus, dt
        self._expected = math.ceil(standing_time / dt)
        self.reset()

    def reset(self) -> None:
        """Restart."""
        self._count, self._times, self._begin = 0, (math.nan, math.nan), math.nan
        self._joints: Array = np.zeros(0)
        self._message: Measurement | None = None  # the last

    @property
    def interval_note(self) -> str:
        """The interval between messages, if it is too long, in words."""
        before, last = self._times
        if not last - before > MAX_INTERVAL * self._dt:
            return ""
        return (
            f"; messages are {last - before:g} s apart, and dt is {self._dt:g} s: are times in s?"
        )

    def add(self, m: Measurement) -> None:
        """Record a message after which there is no estimate yet."""
        self._times, self._message = (self._times[1], m.time), m
        self._count += 1
        if self._count == 1:
            self._joints, self._begin = m.positions, m.time
        if self._count == math.ceil(WARN_AFTER * self._expected) + 1:
            logging.getLogger(__name__).warning("estimator: %s", self.status)

    @property
    def status(self) -> str:
        """Number of messages, and why there is no estimate, in words."""
        reason = "" if self._message is None else f": {self._reason(self._message)}"
        return f"{self._count} messages, and no estimate yet{reason}{self.interval_note}"

    def _reason(self, m: Measurement) -> str:
        leader, (before, last) = self._imus[0].name, self._times
        readings = {one.name: one for one in m.imus}
        if leader not in readings:
            names = ", ".join(map(repr, readings)) or "none"
            return f"there is no reading of IMU {leader!r}, those of the last message are: {names}"
        if not last > before:
            return f"the last message is of {last:g} s, and the one before it of {before:g} s"
        rate = float(np.linalg.norm(readings[leader].angular_velocity))
        moved = np.abs(m.positions - self._joints)
        joint = int(moved.argmax())
        return (
            f"the robot has to stand still; IMU {leader!r} says {rate:.3g} rad/s, and"
            f" {self._robot.joint_names[joint]} is {moved[joint]:.3g} rad or m from where it was"
        )

    def check(self, m: Measurement, first: Estimate) -> None:
        """Check the first estimate. Raises InvalidInputError: all its soles are above its CoM."""
        self._times = self._times[1], m.time
        if self.interval_note:
            logging.getLogger(__name__).warning("estimator: begins%s", self.interval_note)
        interval = (m.time - self._begin) / max(self._count, 1)
        if m.velocities is None and not 0.5 < interval / self._dt < 2.0 and not self.interval_note:
            logging.getLogger(__name__).warning(
                "estimator: messages are %.3g s apart, and dt is %.3g s: the delay of joint"
                " velocities is %.2g of what velocity_delay says; give dt=%.3g",
                *(interval, self._dt, interval / self._dt, interval),
            )
        snapshot, leader = self._robot.snapshot(first.q), self._imus[0]
        flat = [one.frame for one in self._robot.feet.values() if len(one.polygon) > 2]
        tilt = max((math.acos(snapshot.rotation(one)[2, 2].clip(-1, 1)) for one in flat), default=0)
        if tilt > MAX_SOLE_TILT:
            logging.getLogger(__name__).warning(
                "estimator: by IMU %r a sole is tilted by %.2f rad: is its mount on %r right?",
                *(leader.name, tilt, leader.frame),
            )
        lowest = min(snapshot.position(foot.frame)[2] for foot in self._robot.feet.values())
        if lowest > snapshot.com[2]:
            raise InvalidInputError(
                f"estimator: by IMU {leader.name!r} the robot stands on its head. At rest an"
                " accelerometer says +g upwards (specific force): change the signs, or the rotation"
                f" of its mount on {leader.frame!r}"
            )
