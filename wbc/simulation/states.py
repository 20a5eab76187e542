"""Conversion of robot states to MuJoCo's coordinates and back.

In MuJoCo a free base has the linear velocity of its origin in world axes, the angular velocity in
its own, and the quaternion w x y z; here both are in its own axes and the quaternion is x y z w.
With R the base's rotation ``qvel = T v``, T = diag(R, 1, ...), so forces transform by T' and
accelerations by ``qacc = T a + dT/dt v``, dT/dt v = R (w x v_linear). Joints are the same, except
that a continuous one is (cos, sin) here and an angle there.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.robot.limits import BASE_NQ, BASE_NV
from wbc.rotations import rotation_from
from wbc.validate import Array

WXYZ = np.array([3, 0, 1, 2])
XYZW = np.array([1, 2, 3, 0])


class StateMap:
    """Converts states of one robot; entries are found by joint names.

    ``coordinates``, ``velocities``: joint of each entry of MuJoCo's ``qpos`` and ``qvel``; ``base``
    for the base.
    ``base``: pose of a fixed base (7,), position and quaternion xyzw.
    """

    def __init__(self, robot: Robot, model: Any) -> None:
        self.robot = robot
        self.floating = not robot.fixed_base
        self.base = robot.postures["neutral"][:BASE_NQ].copy()
        ids = [int(model.joint(name).id) for name in robot.joint_names]
        self._at_q = np.array([model.jnt_qposadr[j] for j in ids], dtype=np.int64)
        self._at_v = np.array([model.jnt_dofadr[j] for j in ids], dtype=np.int64)
        coordinates, velocities = ["base"] * int(model.nq), ["base"] * int(model.nv)
        for name, at_q, at_v in zip(robot.joint_names, self._at_q, self._at_v, strict=True):
            coordinates[at_q] = velocities[at_v] = name
        self.coordinates, self.velocities = tuple(coordinates), tuple(velocities)
        self.nq, self.nv = int(model.nq), int(model.nv)

    # ------------------------------------------------------------------ from the robot to MuJoCo

    def to_mujoco(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return ``qpos`` and ``qvel`` of a state (nq,), (nv,)."""
        qpos, qvel = np.empty(self.nq), np.empty(self.nv)
        if self.floating:
            qpos[:3], qpos[3:7] = q[:3], q[3:7][WXYZ]
            qvel[:3], qvel[3:6] = rotation_from(q[3:7]) @ v[:3], v[3:6]
        elif v[:BASE_NV].any():
            raise InvalidInputError(f"v: the base of {self.robot.name} is fixed, v[:6] must be 0")
        qpos[self._at_q] = self.robot.limits.joint_positions(q)
        qvel[self._at_v] = v[BASE_NV:]
        return qpos, qvel

    def torques_to_mujoco(self, torque: Array, out: Array) -> None:
        """Write joint torques (nv-6,) to generalised forces ``out``, zero on the base."""
        out[self._at_v] = torque

    # ------------------------------------------------------------------ from MuJoCo to the robot

    def from_mujoco(self, qpos: Array, qvel: Array) -> tuple[Array, Array]:
        """Return the state (nq,), (nv,) of ``qpos`` and ``qvel``; new arrays."""
        q, v = np.empty(self.robot.nq), np.zeros(self.robot.nv)
        if self.floating:
            q[:3], q[3:7] = qpos[:3], qpos[3:7][XYZW]
            v[:3], v[3:6] = qvel[:3] @ rotation_from(q[3:7]), qvel[3:6]
        else:
            q[:BASE_NQ] = self.base
        self.robot.limits.write_positions(q, qpos[self._at_q])
        v[BASE_NV:] = qvel[self._at_v]
        return q, v

    def torques_from_mujoco(self, forces: Array) -> Array:
        """Return the joint torques (nv-6,) of generalised forces; a new array."""
        return forces[self._at_v]


class ContactDrift:
    """Subtracts J' q' from the reference accelerations of contacts, before MuJoCo solves.

    A point of a chain of joints accelerates by J q'' + J' q', but MuJoCo lets J q'' alone follow
    its reference, -b J q' - k r, so a foot that should rest creeps at J' q'/b, b =
    2/``time_constant``. Where legs fold at 2.7 m/s, J' q' is 70 m/s^2: the foot is pressed harder
    as the robot comes down, and is then lifted although its leg pushes it down. ``model``: MuJoCo's
    own.
    """

    def __init__(self, model: Any) -> None:
        self._model = model
        moves = np.zeros((model.nbody, model.nv))  # 1 where a velocity moves a body
        for body in range(1, model.nbody):
            moves[body] = moves[model.body_parentid[body]] + (model.dof_bodyid == body)
        self._moves = moves

    def subtract(self, data: Any) -> None:
        """Change ``data.efc_aref``, between ``mj_step1`` and ``mj_step2``."""
        contact = data.contact
        for row, drift in zip(contact.efc_address.tolist(), self.at(data), strict=True):
            if row >= 0:
                data.efc_aref[row : row + 3] -= drift

    def at(self, data: Any) -> Array:
        """Return J' q' (k, 3) of all contacts, along their normals and both tangents [m/s^2]."""
        model, contact = self._model, data.contact
        bodies = model.geom_bodyid[contact.geom]  # (k, 2)
        arms = contact.pos[:, None] - data.subtree_com[model.body_rootid[bodies]]  # (k, 2, 3)
        spin, velocity = np.split(data.cvel[bodies], 2, axis=-1)
        # Spatial accelerations without q'', about the point that ``cvel`` is about, too.
        bias = self._moves[bodies] @ (data.cdof_dot * data.qvel[:, None])
        turning, moving = np.split(bias, 2, axis=-1)
        points = moving + np.cross(turning, arms) + np.cross(spin, velocity + np.cross(spin, arms))
        frames = contact.frame.reshape(-1, 3, 3)
        return np.asarray(np.einsum("kij,kj->ki", frames, points[:, 1] - points[:, 0]))
