"""States predicted over a known delay, by the accelerations that were commanded meanwhile.

What is measured is as old as sensors and filters make it, and a torque acts as late as bus and
drives have it. A controller that answers to the state of then with torques for now acts on errors
that it has corrected already. What became of the state since is known but for what disturbs it:
each torque was found with the acceleration that it causes (the dynamics are rows of the tick's QP),
so the state is integrated over them (a finite spectrum assignment, Manitius & Olbrot 1979).
"""

from __future__ import annotations

import math
from collections import deque

from wbc.robot import Robot, Snapshot
from wbc.validate import Array

_EVEN = 1e-9  # a delay is so many ticks, to this part of one


class StatePrediction:
    """Predicts measured states over a delay.

    Parameters
    ----------
    delay:
        From the instant that is measured to the one at which the torque that answers acts [s].
    dt:
        Of a tick [s].
    """

    def __init__(self, robot: Robot, delay: float, dt: float) -> None:
        self.robot, self.delay, self.dt = robot, delay, dt
        whole = math.ceil(delay / dt - _EVEN)
        # Commands of the delay, the oldest first, of which only a part may fall into it.
        self._commanded = deque[Array](maxlen=whole)
        self._oldest = delay - (whole - 1) * dt
        self._last: tuple[Snapshot, Snapshot] | None = None

    def ahead(self, snapshot: Snapshot) -> Snapshot:
        """Return the state at which the torque acts that answers to ``snapshot``.

        Before as many ticks as the delay has, velocities are taken as constant where none is known.
        """
        if self._last is not None and self._last[0] is snapshot:
            return self._last[1]
        q, v, count = snapshot.q, snapshot.v, len(self._commanded)
        rest = self.delay
        for k, acceleration in enumerate(self._commanded):
            time = self._oldest if count == self._commanded.maxlen and k == 0 else self.dt
            later = v + time * acceleration
            q, v = self.robot.integrate(q, 0.5 * (v + later), time), later
            rest -= time
        if rest > _EVEN * self.dt:
            q = self.robot.integrate(q, v, rest)
        found = self.robot.snapshot(q, v)
        self._last = snapshot, found
        return found

    def commanded(self, acceleration: Array) -> None:
        """Take note of what the last command causes (nv,)."""
        self._commanded.append(acceleration)
