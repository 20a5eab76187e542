"""Pinocchio's scratch memory of one robot, and which snapshot it holds at the moment.

Allocating a ``pin.Data`` costs more than a whole control tick, so a robot owns one set for all its
snapshots. A snapshot that reads from it first makes sure that the passes were run at its own state:
results are therefore always right, whatever was evaluated in between. Not safe to share between
threads: give each thread its own :class:`~wbc.robot.model.Robot`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from wbc.validate import Array


class Workspace:
    """Scratch memory for the passes over one model."""

    def __init__(self, model: pin.Model) -> None:
        self.model = model
        self.weightless = model.copy()
        self.weightless.gravity = pin.Motion.Zero()
        self.spins = np.zeros((6, model.nv))  # of `inertia.joint_rates`: v of the spinning robot
        self.torques = np.empty((6, model.nv))  # and what holds its joints
        self.kinematics_data = model.createData()
        self.kinematics_owner: Any = None
        self.placements = JointPlacements(self.kinematics_data)
        self._rates = model.createData()
        self._rates_owner: Any = None
        self.scratch = model.createData()
        self.at_rest = np.zeros(model.nv)

    def kinematics(self, owner: Any, q: Array, v: Array) -> pin.Data:
        """Return data holding placements, joint Jacobians, centroidal map and inertia at (q, v)."""
        if self.kinematics_owner is not owner:
            self.kinematics_owner = None  # an exception half-way must not leave a false claim
            pin.ccrba(self.model, self.kinematics_data, q, v)
            self.kinematics_owner = owner
        return self.kinematics_data

    def rates(self, owner: Any, q: Array, v: Array) -> pin.Data:
        """Return data holding body velocities, and accelerations for zero joint acceleration."""
        if self._rates_owner is not owner:
            self._rates_owner = None
            pin.forwardKinematics(self.model, self._rates, q, v, self.at_rest)
            pin.dccrba(self.model, self._rates, q, v)
            pin.centerOfMass(self.model, self._rates, q, v, self.at_rest, False)
            self._rates_owner = owner
        return self._rates


class JointPlacements:
    """A window on ``data.oMi``: rotations (njoints, 3, 3) and origins (njoints, 3), world axes.

    Reading 31 placements from Python takes 13 us, copying them through this window 1. They lie in
    one block of memory at a constant distance, which is checked once; where they do not, they are
    read one by one. The arrays follow the data: copy what should last. Entry 0 is the world.
    """

    def __init__(self, data: pin.Data) -> None:
        self._data = data  # the views must not outlive the memory they look at
        self._rotations = side_by_side([pose.rotation for pose in data.oMi])
        self._origins = side_by_side([pose.translation for pose in data.oMi])

    def copies(self) -> tuple[Array, Array]:
        """Return fresh arrays of rotations and origins as they are in the data now."""
        if self._rotations is None or self._origins is None:
            poses = list(self._data.oMi)
            rotations = np.array([pose.rotation for pose in poses])
            return rotations, np.array([pose.translation for pose in poses])
        return self._rotations.copy(order="C"), self._origins.copy()


def side_by_side(fields: Sequence[Any]) -> Array | None:
    """Return one view (n, ...) on n arrays that lie at a constant distance in memory, or None.

    The view does not keep alive what it looks at.
    """
    first = fields[0]
    steps = np.unique(np.diff([field.ctypes.data for field in fields]))
    if len(steps) > 1 or any(field.flags.owndata for field in fields):
        return None
    step = int(steps[0]) if len(steps) else first.nbytes
    shape, strides = (len(fields), *first.shape), (step, *first.strides)
    return np.lib.stride_tricks.as_strided(first, shape=shape, strides=strides, writeable=False)
