"""Warns once of a user's loop that never passes the velocity, so that each tick begins at rest.

From rest a joint reaches at most its acceleration limit times dt, in each tick: at the velocity
level the robot creeps, at the torque level nothing is damped.
"""

from __future__ import annotations

import logging
import math

import numpy as np

from wbc.constraints.limits import Limits
from wbc.robot import Snapshot
from wbc.robot.limits import BASE_NV
from wbc.validate import Array

TICKS = 3  # consecutive ticks at rest between which the robot moves as commanded
# A motion counts as commanded from this ratio of lengths and this cosine of directions on.
LEAST_RATIO, LEAST_COSINE = 0.1, 0.7
AT_LIMIT = 0.99  # part of a velocity's bound


class MissingVelocity:
    """Detects ticks at rest between which the robot moves.

    ``dt``: time step [s].
    ``damped``: whether the tasks' laws read the velocity: at the torque level.
    """

    def __init__(self, dt: float, damped: bool) -> None:
        self._dt, self._damped = dt, damped
        self._ticks, self._warned = 0, False
        self._measured = b""  # of the last tick at rest
        self._velocity: Array = np.empty(0)  # that it commanded
        self._q: Array | None = None  # its joints' positions

    def watch(self, snapshot: Snapshot, velocity: Array, limits: Limits | None) -> None:
        """Record a tick at rest; warn at the third in a row between which the robot moved."""
        if self._warned:
            return
        last, self._velocity = self._velocity, velocity
        if snapshot.measured == self._measured:  # it does not move: most ticks at rest
            self._ticks = 1
            return
        self._measured = snapshot.measured
        before, self._q = self._q, snapshot.joint_positions
        follows = before is not None and _follows(self._q - before, self._dt * last[BASE_NV:])
        holds = self._damped or (limits is not None and self._at_limit(velocity, limits))
        self._ticks = self._ticks + 1 if follows and holds else 1
        if self._ticks >= TICKS:
            self._warned = True
            why = (
                "without it nothing is damped"
                if self._damped
                else "each tick begins at rest, so the acceleration limits let no joint get faster"
                " than in the first"
            )
            logging.getLogger(__name__).warning(
                "controller: v is 0 in %d ticks in a row, though %s moves: %s; give the measured"
                " velocity, or the last command where it is integrated:"
                " snapshot = robot.snapshot(q, tick.velocity)",
                *(TICKS, snapshot.robot.name, why),
            )

    def _at_limit(self, velocity: Array, limits: Limits) -> bool:
        most = self._dt * limits.acceleration
        return bool((np.abs(velocity[BASE_NV:]) >= AT_LIMIT * np.minimum(most, 1e9)).any())


def _follows(moved: Array, step: Array) -> bool:
    """Whether joints moved as commanded, roughly."""
    along, size = float(moved @ step), float(step @ step)
    return 0.0 < LEAST_RATIO * size <= along and along >= LEAST_COSINE * math.sqrt(
        size * float(moved @ moved)
    )
