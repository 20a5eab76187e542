"""Pinocchio's scratch memory of one robot, and which snapshot it holds at the moment.

Allocating a ``pin.Data`` costs more than a whole control tick, so a robot owns one set for all its
snapshots. A snapshot that reads from it first makes sure that the passes were run at its own state:
results are therefore always right, whatever was evaluated in between. Not safe to share between
threads: give each thread its own :class:`~wbc.robot.model.Robot`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from wbc.robot.placements import JointPlacements
from wbc.validate import Array


class Workspace:
    """Scratch memory for the passes over one model."""

    def __init__(self, model: pin.Model) -> None:
        self.model = model
        self.weightless = model.copy()
        self.weightless.gravity = pin.Motion.Zero()
        self.spins = np.zeros((6, model.nv))  # of `inertia.joint_rates`: v of the spinning robot
        self.torques = np.empty((6, model.nv))  # and what holds its joints
        self._kinematics = model.createData()
        self._kinematics_owner: Any = None
        self.placements = JointPlacements(self._kinematics)
        self._rates = model.createData()
        self._rates_owner: Any = None
        self.scratch = model.createData()
        self.at_rest = np.zeros(model.nv)

    def kinematics(self, owner: Any, q: Array, v: Array) -> pin.Data:
        """Return data holding placements, joint Jacobians, centroidal map and inertia at (q, v)."""
        if self._kinematics_owner is not owner:
            self._kinematics_owner = None  # an exception half-way must not leave a false claim
            pin.ccrba(self.model, self._kinematics, q, v)
            self._kinematics_owner = owner
        return self._kinematics

    def rates(self, owner: Any, q: Array, v: Array) -> pin.Data:
        """Return data holding body velocities, and accelerations for zero joint acceleration."""
        if self._rates_owner is not owner:
            self._rates_owner = None
            pin.forwardKinematics(self.model, self._rates, q, v, self.at_rest)
            pin.dccrba(self.model, self._rates, q, v)
            pin.centerOfMass(self.model, self._rates, q, v, self.at_rest, False)
            self._rates_owner = owner
        return self._rates
