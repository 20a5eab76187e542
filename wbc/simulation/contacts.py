"""The true contact forces of a simulation, by foot and in total."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from wbc.controllers.contact_forces import LEAST_NORMAL_Z
from wbc.simulation.build import CompiledModel
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contact points of the robot with the ground or a step, at one instant.

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
        """Components (k,) of the forces along the normals [N]."""
        return (self.forces * self.normals).sum(axis=1)

    @property
    def cop(self) -> Array | None:
        """Centre of pressure (3,) [m]: mean of the points by normal force; None in the air.

        On one plane that is where the ground's force has no moment about any axis in the plane.
        Walls do not count.
        """
        weights = np.where(self.normals[:, 2] > LEAST_NORMAL_Z, self.normal_forces, 0.0)
        total = float(weights.sum())
        return weights @ self.points / total if total > 0.0 else None

    def load(self, foot: str) -> float:
        """Return the normal force on a foot's sole [N]."""
        return float(self.normal_forces[[name == foot for name in self.feet]].sum())

    def force_at(self, link: str) -> Array:
        """Return the force (3,) on a link, or on the hand at a frame [N], world axes."""
        return self.forces[[name == link for name in self.links]].sum(axis=0)

    def wrench(self, foot: str, origin: Array) -> Array:
        """Return force and moment about ``origin`` (6,) on a foot's sole, world axes [N, N m]."""
        own = [k for k, name in enumerate(self.feet) if name == foot]
        f, (x, y, z) = self.forces[own], (self.points[own] - origin).T
        fx, fy, fz = f.T
        moment = (y @ fz - z @ fy, z @ fx - x @ fz, x @ fy - y @ fx)
        return np.concatenate((f.sum(axis=0), moment))


def read_contacts(mujoco: Any, compiled: CompiledModel, data: Any) -> Contacts:
    """Return the contacts with the ground in the last step (or ``mj_forward``)."""
    contact, links = data.contact, compiled.links
    pairs = contact.geom.tolist()
    chosen = [k for k, (a, b) in enumerate(pairs) if not (links[a] and links[b])]
    count = len(chosen)
    points, frames = contact.pos[chosen], contact.frame[chosen].reshape(count, 3, 3)
    local, geoms, signs = np.zeros((count, 6)), list[int](), np.ones(count)
    for row, k in enumerate(chosen):
        mujoco.mj_contactForce(compiled.model, data, k, local[row])
        # The frame's first row is the normal, from the first geom to the second, on which the force
        # acts. MuJoCo orders a pair by the geoms' types: either may be the robot.
        first, second = pairs[k]
        geoms.append(second if links[second] else first)
        signs[row] = 1.0 if links[second] else -1.0
    forces = np.einsum("kij,ki->kj", frames, local[:, :3]) * signs[:, None]
    return Contacts(
        points=points,
        forces=forces,
        normals=frames[:, 0] * signs[:, None],
        feet=tuple(compiled.feet[g] for g in geoms),
        links=tuple(links[g] for g in geoms),
    )


def touched_by_links(compiled: CompiledModel, data: Any) -> dict[str, str]:
    """Return what links touch with anything but a sole, sorted by link.

    That is ``ground``, or a step or wall by its number. Hands and their forearms may touch walls.
    """
    links, touched = compiled.links, dict[str, str]()
    for pair in data.contact.geom.tolist():
        own = [geom for geom in pair if links[geom]]
        others = [geom for geom in pair if not links[geom]]
        is_leaning = not compiled.walls.isdisjoint(pair) and not compiled.forearms.isdisjoint(pair)
        if len(own) == 1 and not compiled.feet[own[0]] and not is_leaning:
            touched[links[own[0]]] = str(compiled.model.geom(others[0]).name)
    return dict(sorted(touched.items()))


def self_contacts(compiled: CompiledModel, data: Any) -> tuple[tuple[str, str], ...]:
    """Return the pairs of links that touch each other."""
    pairs = ((compiled.links[a], compiled.links[b]) for a, b in data.contact.geom.tolist())
    return tuple(sorted({(min(pair), max(pair)) for pair in pairs if all(pair)}))
