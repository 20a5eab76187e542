"""What forces and torques are by the unknowns x = (v+, f) of one torque tick.

One step of the floating-base dynamics, D the joints' damping,

    M (v+ - v)/dt + bias + D v+ = [0; tau] + J' f

makes the base forces and torques an affine expression of x.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wbc.controllers.contact_forces import ContactForces, Reaction
from wbc.robot import Snapshot
from wbc.tasks.force_task import Affine
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class TickDynamics:
    """The :class:`~wbc.tasks.force_task.Dynamics` of one tick."""

    snapshot: Snapshot
    forces: ContactForces
    # Returns base forces and torques (nv, n) by the unknowns, in units of ``unit``, and (nv,) at
    # zero unknowns, as the core finds them: only tasks about torques ask.
    physics: Callable[[], tuple[Array, Array]]
    last: Reaction | None  # the forces of the last tick; None if there was none

    @cached_property
    def _physics(self) -> tuple[Array, Array]:
        return self.physics()

    def torques(self, x: Array) -> Array:
        """Return the torques (nv - 6,) of all joints [N m] at x (n,)."""
        matrix, offset = self._physics
        torques: Array = matrix[6:].dot(x)
        torques += offset[6:]
        torques *= self.unit
        return torques

    @property
    def size(self) -> int:
        """How many unknowns there are."""
        return int(self.snapshot.robot.nv) + self.forces.size

    @property
    def unit(self) -> float:
        """Newtons per unit of a force unknown."""
        return self.forces.unit

    @cached_property
    def contacts(self) -> Sequence[str]:
        """Frames of the contacts that bear forces."""
        return self.forces.frames

    @cached_property
    def _wrenches(self) -> dict[str, Array]:
        return {}

    def wrench(self, frame: str) -> Array:
        """Return (6, n): a contact's wrench at its frame's origin, world axes, by the unknowns."""
        if frame not in self._wrenches:
            wrench, nv = np.zeros((6, self.size)), self.snapshot.robot.nv
            if frame in self.contacts:
                self.forces.wrench_map(frame, self.snapshot, out=wrench[:, nv:])
                wrench *= self.unit
            self._wrenches[frame] = wrench
        return self._wrenches[frame]

    def torque(self, joints: Sequence[int]) -> Affine:
        """Return the torques of some joints [N m]."""
        rows = [6 + k for k in joints]
        matrix, offset = self._physics
        return Affine(self.unit * matrix[rows], self.unit * offset[rows])

    def last_wrench(self, frame: str) -> Array | None:
        """Return what the last tick decided; of a contact that was none, zero."""
        return None if self.last is None else self._last_wrenches.get(frame, np.zeros(6))

    @cached_property
    def _last_wrenches(self) -> Mapping[str, Array]:
        return {} if self.last is None else self.last.wrenches()
