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
        return (self.forces * self.normals).sum(axis=1)

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
        f, (x, y, z) = self.forces[mine], (self.points[mine] - origin).T
        fx, fy, fz = f.T
        moment = (y @ fz - z @ fy, z @ fx - x @ fz, x @ fy - y @ fx)
        return np.concatenate((f.sum(axis=0), moment))


def read_contacts(mujoco: Any, built: Built, data: Any) -> Contacts:
    """Return the contacts that the last physics step (or ``mj_forward``) found."""
    contact, count = data.contact, int(data.ncon)
    points, frames = np.array(contact.pos), np.array(contact.frame).reshape(count, 3, 3)
    local = np.zeros((count, 6))
    for k in range(count):
        mujoco.mj_contactForce(built.model, data, k, local[k])
    # The frame's first row is the normal, from the first geom to the second, on which the force
    # acts; MuJoCo orders a pair by the geoms' types, so that either may be the robot.
    mine, signs = list[int](), np.ones(count)
    for k, (first, second) in enumerate(contact.geom.tolist()):
        mine.append(second if built.links[second] else first)
        signs[k] = 1.0 if built.links[second] else -1.0
    forces = np.einsum("kij,ki->kj", frames, local[:, :3]) * signs[:, None]
    return Contacts(
        points=points.reshape(count, 3),
        forces=forces,
        normals=frames[:, 0] * signs[:, None],
        feet=tuple(built.feet[g] for g in mine),
        links=tuple(built.links[g] for g in mine),
    )


def touching_links(built: Built, data: Any) -> tuple[str, ...]:
    """Return the links that touch with anything but a sole, without reading any force."""
    geoms = {geom for pair in data.contact.geom.tolist() for geom in pair}
    found = {built.links[geom] for geom in geoms if built.links[geom] and not built.feet[geom]}
    return tuple(sorted(found))
