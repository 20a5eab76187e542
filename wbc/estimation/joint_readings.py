"""Joint positions that may be wrong for a moment, and the velocities that they have."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.errors import listed
from wbc.estimation.contact_filter import Counts
from wbc.estimation.joint_velocity import JointVelocityFilter
from wbc.estimation.measurement import Measurement
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.validate import Array

JUMP = 3.0  # times what a joint's speed limit allows in one period: a reading is wrong
LEEWAY = 5e-3  # rad or m, besides
# A joint whose readings jumped is believed after so many that agree: it is where they say.
AGREE = 5


class JointMemory(NamedTuple):
    """What :class:`JointReadings` knows between two messages."""

    velocity: tuple[Array, Array, int]
    positions: Array | None
    distrusted: Counts


class JointReadings:
    """Positions and velocities of the joints, message by message.

    A reading that jumped farther than a joint can move is held back, for a few messages: if it
    stays where it jumped to, that is where the joint is.
    """

    def __init__(self, robot: Robot, window: int, dt: float) -> None:
        joints = robot.nv - BASE_NV
        self._names, self._most = robot.joint_names, JUMP * robot.limits.velocity
        self._filter = JointVelocityFilter(joints, window, dt)
        self.delay = self._filter.delay
        self._positions: Array | None = None
        self._distrusted: Counts = np.zeros(joints, dtype=np.int64)

    def reset(self) -> None:
        """Forget all readings."""
        self._filter.reset()
        self._positions, self._distrusted = None, np.zeros_like(self._distrusted)

    def take(self, m: Measurement, dt: float, notes: list[str]) -> tuple[Array, Array]:
        """Return positions and velocities (nv-6,), ``dt`` [s] after the last; note what is held."""
        positions = self._believed(m.positions, dt, notes)
        rates = self._filter.update(m.time, positions)
        return positions, rates if m.velocities is None else m.velocities

    def _believed(self, positions: Array, dt: float, notes: list[str]) -> Array:
        before = self._positions
        if before is not None:
            jumped = np.abs(positions - before) > self._most * dt + LEEWAY
            if jumped.any() or self._distrusted.any():
                self._distrusted = np.where(jumped, self._distrusted + 1, 0)
                doubted = jumped & (self._distrusted < AGREE)
                if doubted.any():
                    names = [self._names[k] for k in np.flatnonzero(doubted)]
                    notes.append(f"joint {listed(names)}: position jumped; held")
                    positions = np.where(doubted, before, positions)
        self._positions = positions
        return positions

    def memory(self) -> JointMemory:
        """Return all that it knows, for :meth:`restore`."""
        return JointMemory(self._filter.memory(), self._positions, self._distrusted)

    def restore(self, memory: JointMemory) -> None:
        """Go back to what :meth:`memory` returned."""
        self._filter.restore(memory.velocity)
        self._positions, self._distrusted = memory.positions, memory.distrusted
