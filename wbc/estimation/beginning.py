"""The time in which an estimator waits for a robot that stands still: what keeps it, in words."""

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

PATIENCE = 4.0  # times the messages that it usually takes to begin: then it is said what keeps it
STEEP = 0.35  # rad of a sole's tilt: no ground that robots begin on
APART = 20.0  # times the period: messages that are so far apart may have another unit of time


class Beginning:
    """Watches an estimator's messages until there is an estimate, and says what is odd, once."""

    def __init__(
        self, robot: Robot, imus: Sequence[ImuMount], standing_time: float, dt: float
    ) -> None:
        self._robot, self._imus, self._dt = robot, imus, dt
        self._usual = math.ceil(standing_time / dt)
        self.anew()

    def anew(self) -> None:
        """Begin anew."""
        self._count, self._times = 0, (math.nan, math.nan)
        self._joints: Array = np.zeros(0)
        self._message: Measurement | None = None  # the last

    @property
    def apart(self) -> str:
        """How far apart messages are, if that is odd, in words."""
        before, last = self._times
        if not last - before > APART * self._dt:
            return ""
        return (
            f"; messages are {last - before:g} s apart, and dt is {self._dt:g} s: are times in s?"
        )

    def waits(self, m: Measurement) -> None:
        """Take in a message after which there is no estimate yet."""
        self._times, self._message = (self._times[1], m.time), m
        self._count += 1
        if self._count == 1:
            self._joints = m.positions
        if self._count == math.ceil(PATIENCE * self._usual) + 1:
            logging.getLogger(__name__).warning("estimator: %s", self.told)

    @property
    def told(self) -> str:
        """How many messages came, and what keeps the estimator, in words."""
        why = "" if self._message is None else f": {self._reason(self._message)}"
        return f"{self._count} messages, and no estimate yet{why}{self.apart}"

    def _reason(self, m: Measurement) -> str:
        leader, (before, last) = self._imus[0].name, self._times
        said = {one.name: one for one in m.imus}
        if leader not in said:
            names = ", ".join(map(repr, said)) or "none"
            return f"there is no reading of IMU {leader!r}, those of the last message are: {names}"
        if not last > before:
            return f"the last message is of {last:g} s, and the one before it of {before:g} s"
        rate = float(np.linalg.norm(said[leader].angular_velocity))
        moved = np.abs(m.positions - self._joints)
        most = int(moved.argmax())
        return (
            f"the robot has to stand still; IMU {leader!r} says {rate:.3g} rad/s, and"
            f" {self._robot.joint_names[most]} is {moved[most]:.3g} rad or m from where it was"
        )

    def check(self, m: Measurement, first: Estimate) -> None:
        """Look at the first estimate.

        Raises
        ------
        InvalidInputError
            By it all soles are above the CoM.
        """
        self._times = self._times[1], m.time
        if self.apart:
            logging.getLogger(__name__).warning("estimator: begins%s", self.apart)
        snapshot, leader = self._robot.snapshot(first.q), self._imus[0]
        flat = [one.frame for one in self._robot.feet.values() if len(one.polygon) > 2]
        lean = max((math.acos(snapshot.rotation(one)[2, 2].clip(-1, 1)) for one in flat), default=0)
        if lean > STEEP:
            logging.getLogger(__name__).warning(
                "estimator: by IMU %r a sole is tilted by %.2f rad: is its mount on %r right?",
                *(leader.name, lean, leader.frame),
            )
        lowest = min(snapshot.position(foot.frame)[2] for foot in self._robot.feet.values())
        if lowest > snapshot.com[2]:
            raise InvalidInputError(
                f"estimator: by IMU {leader.name!r} the robot stands on its head. At rest an"
                " accelerometer says +g upwards (specific force): change the signs, or the rotation"
                f" of its mount on {leader.frame!r}"
            )
