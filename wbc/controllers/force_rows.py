"""The torque level's rows for the native core: contact forces, their cones, torque bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wbc.constraints.contact import PointContact
from wbc.controllers.contact_forces import ContactForces
from wbc.native import ffi
from wbc.robot import Robot, Snapshot
from wbc.tasks.task import Task
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class TorqueRows:
    """The rows of a torque level that do not come from tasks."""

    forces: ContactForces  # the unknowns behind v+
    passive: NDArray[np.int64]  # entries of v without a motor
    bounded: NDArray[np.int64]  # entries of v with a torque bound
    most: Array  # torque bounds, in units of the forces
    labels: tuple[str, ...]  # of the torque bounds
    deceleration: Array  # (nv - 6,) of joints before their limits [rad/s^2 or m/s^2]
    spring_time: float  # time constant [s] of springs of joints without a motor, in contact
    # (nv,) generalised forces of this tick's known wrenches [N, N m]; the controller writes them.
    known_forces: Array


class NativeForces:
    """The torque level's arrays in the core.

    ``blocks``: block number of each contact that is met exactly.

    ``arrays``: by the names of ``wbc_plan`` in source/core.h.
    ``structs``: the force unknowns of each contact, ``wbc_force[]``.
    ``stale``: whether a contact was changed since the cones were written.
    """

    def __init__(
        self, rows: TorqueRows, blocks: Mapping[Task, int], robot: Robot, dt: float
    ) -> None:
        self.rows = rows
        forces = rows.forces
        corners: list[Array] = [np.zeros((0, 3))]
        described, begin = [], 0
        for part in forces.parts:
            contact = part.contact
            width = part.columns.stop - part.columns.start
            points = 0 if part.grasp is None else width // 3
            described.append(
                {
                    "block": blocks[contact],
                    "column": part.columns.start,
                    "count": width,
                    "corners": points,
                    "corner": 3 * begin,
                    "aligned": isinstance(contact, PointContact),
                }
            )
            if part.surface is not None and part.surface.corners is not None:
                corners.append(part.surface.corners)
                begin += points
        self.count = len(described)
        self.structs = ffi.new("wbc_force[]", described)
        self.passive = np.array(rows.passive, dtype=np.int64)
        self.bounded = np.array(rows.bounded, dtype=np.int64)
        springs = robot.closure.sprung if forces.surfaces else ()
        self._sprung = np.array([robot.joint_index(joint) for joint in springs], dtype=np.int64)
        stiffness = np.array([robot.passive.springs[joint].stiffness for joint in springs])
        self._yielding = stiffness * rows.spring_time**2 / dt
        damping = np.array(robot.damping, dtype=float)
        damping[self._sprung - 6] += self._yielding
        self.load = np.zeros(robot.nv)
        cones = forces.bounds()
        self.cones = len(cones.labels)
        self.cone = np.concatenate((cones.matrix.ravel(), cones.lower, cones.upper))
        self.labels = rows.labels + cones.labels
        self.arrays = {
            "corner": np.concatenate(corners).ravel(),
            "passive": self.passive,
            "with_bound": self.bounded,
            "torque_bound": np.array(rows.most, dtype=float),
            "cone": self.cone,
            "force_bound": np.concatenate((forces.lower, forces.upper)),
            "joint_damping": damping,
            "load": self.load,
        }
        self._ramps: Mapping[str, float] = {}
        self.stale = False

    def write_load(self, robot: Robot, snapshot: Snapshot) -> None:
        """Write the forces that are not commanded: known wrenches, springs."""
        self.load[:] = self.rows.known_forces
        if robot.passive:
            self.load += robot.passive_forces_at(snapshot)
            self.load[self._sprung] += self._yielding * snapshot.v[self._sprung]

    def write(self, ramps: Mapping[str, float]) -> bool:
        """Write the cones if contacts were changed or forces ramp; False if their size differs."""
        if not self.stale and ramps == self._ramps:
            return True
        cones = self.rows.forces.bounds(ramps)
        if cones.matrix.size + 2 * len(cones.labels) != self.cone.size:
            return False
        np.concatenate((cones.matrix.ravel(), cones.lower, cones.upper), out=self.cone)
        self.labels, self._ramps = self.rows.labels + cones.labels, dict(ramps)
        self.stale = False
        return True
