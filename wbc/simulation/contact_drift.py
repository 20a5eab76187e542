"""The drift J' q' of contact points, which MuJoCo's contacts neglect.

A point of a chain of joints accelerates by J q'' + J' q', but MuJoCo lets J q'' alone follow its
reference, -b J q' - k r. So a foot that should rest creeps at J' q'/b, b = 2/``time_constant``.
Where legs fold at 2.7 m/s, J' q' is 70 m/s^2: the foot is pressed harder as the robot comes down,
and is then lifted off the ground although its leg pushes it down.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wbc.validate import Array


class ContactDrift:
    """Subtracts J' q' from the reference accelerations of contacts, before MuJoCo solves.

    ``model``: MuJoCo's own.
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
