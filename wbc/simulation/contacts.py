"""Contact forces as they act in the simulation, by foot and altogether."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from wbc.simulation.build import Built
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class Contacts:
    """Points at which the robot touches the ground or a step, at one instant.

    Attributes
    ----------
    points:
        (k, 3) [m], world axes.
    forces:
        (k, 3) on the robot [N], world axes.
    normals:
        (k, 3) unit vectors out of the ground.
    feet:
        (k) the foot whose sole touches; empty for any other shape.
    links:
        (k) the link that touches.
    """

    points: Array
    forces: Array
    normals: Array
    feet: tuple[str, ...]
    links: tuple[str, ...]

    @property
    def normal_forces(self) -> Array:
        """Parts (k,) of the forces along the normals [N]."""
        return np.einsum("ij,ij->i", self.forces, self.normals)

    @property
    def cop(self) -> Array | None:
        """Centre of pressure (3,) [m]: mean of the points by normal force; None in the air.

        On one plane that is where the ground's force has no moment about any axis in the plane.
        """
        weights = self.normal_forces
        total = float(weights.sum())
        return weights @ self.points / total if total > 0.0 else None

    def wrench(self, foot: str, origin: Array) -> Array:
        """Return force and moment about ``origin`` (6,) on a foot's sole, world axes [N, N m]."""
        mine = [k for k, name in enumerate(self.feet) if name == foot]
        forces, arms = self.forces[mine], self.points[mine] - origin
        return np.concatenate((forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)))

    def others(self) -> tuple[str, ...]:
        """Return the links that touch with anything but a sole."""
        pairs = zip(self.feet, self.links, strict=True)
        return tuple(sorted({link for foot, link in pairs if not foot}))


def read_contacts(mujoco: Any, built: Built, data: Any) -> Contacts:
    """Return the contacts that the last physics step (or ``mj_forward``) found."""
    count = int(data.ncon)
    contact = data.contact
    points, frames = np.array(contact.pos), np.array(contact.frame).reshape(count, 3, 3)
    pairs = np.array(contact.geom).reshape(count, 2)
    local = np.zeros((count, 6))
    for k in range(count):
        mujoco.mj_contactForce(built.model, data, k, local[k])
    # The frame's first row is the normal, from the first geom to the second, on which the force
    # acts; MuJoCo orders a pair by the geoms' types, so that either may be the robot.
    mine = [int(b) if built.links[b] else int(a) for a, b in pairs]
    signs = np.where(pairs[:, 1] == mine, 1.0, -1.0) if count else np.empty(0)
    forces = np.einsum("kij,ki->kj", frames, local[:, :3]) * signs[:, None]
    return Contacts(
        points=points.reshape(count, 3),
        forces=forces,
        normals=frames[:, 0] * signs[:, None],
        feet=tuple(built.soles[g] for g in mine),
        links=tuple(built.links[g] for g in mine),
    )
