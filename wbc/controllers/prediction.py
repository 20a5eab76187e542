"""State prediction over a known delay, from the accelerations commanded meanwhile.

Sensors, filters, bus and drives delay measurements and torques. A controller that uses the old
state acts on errors that it has corrected already. The dynamics in each tick's QP give the
acceleration that its torque causes, so the measured state is integrated with these over the delay
(finite spectrum assignment, Manitius & Olbrot 1979); disturbances meanwhile are unknown.
"""

from __future__ import annotations

import math
from collections import deque

from wbc.robot import Robot, Snapshot
from wbc.validate import Array

_EVEN = 1e-9  # tolerance of a delay that is a whole number of ticks, in ticks


class StatePrediction:
    """Predicts measured states over a delay.

    ``delay``: from the measurement to the instant at which the resulting torque acts [s].
    ``dt``: of a tick [s].
    """

    def __init__(self, robot: Robot, delay: float, dt: float) -> None:
        self.robot, self.delay, self.dt = robot, delay, dt
        whole = math.ceil(delay / dt - _EVEN)
        # Commands within the delay, oldest first; the oldest acts only for part of a tick.
        self._accelerations = deque[Array](maxlen=whole)
        self._oldest = delay - (whole - 1) * dt
        self._last: tuple[Snapshot, Snapshot] | None = None

    def predict(self, snapshot: Snapshot) -> Snapshot:
        """Return the state at which the torque computed for ``snapshot`` acts.

        In the first ticks the velocity is taken as constant until the first command acts.
        """
        if self._last is not None and self._last[0] is snapshot:
            return self._last[1]
        q, v, count = snapshot.q, snapshot.v, len(self._accelerations)
        missing = self.delay - count * self.dt
        if missing > _EVEN * self.dt:
            q = self.robot.integrate(q, v, missing)
        for k, acceleration in enumerate(self._accelerations):
            time = self._oldest if count == self._accelerations.maxlen and k == 0 else self.dt
            later = v + time * acceleration
            q, v = self.robot.integrate(q, 0.5 * (v + later), time), later
        found = self.robot.snapshot(q, v)
        self._last = snapshot, found
        return found

    def record(self, acceleration: Array) -> None:
        """Add the acceleration (nv,) of the last command."""
        self._accelerations.append(acceleration)
        self._last = None

    def reset(self) -> None:
        """Forget the commands: the robot was put elsewhere."""
        self._accelerations.clear()
        self._last = None
