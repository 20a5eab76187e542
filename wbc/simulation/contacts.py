"""Contact forces as they act in the simulation, by foot and altogether."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from wbc.controllers.contact_forces import STEEP
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
        Walls are none of it.
        """
        weights = np.where(self.normals[:, 2] > STEEP, self.normal_forces, 0.0)
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
        mine = [k for k, name in enumerate(self.feet) if name == foot]
        f, (x, y, z) = self.forces[mine], (self.points[mine] - origin).T
        fx, fy, fz = f.T
        moment = (y @ fz - z @ fy, z @ fx - x @ fz, x @ fy - y @ fx)
        return np.concatenate((f.sum(axis=0), moment))


def read_contacts(mujoco: Any, built: Built, data: Any) -> Contacts:
    """Return the contacts with the ground that the last step (or ``mj_forward``) found."""
    contact, links = data.contact, built.links
    pairs = contact.geom.tolist()
    chosen = [k for k, (a, b) in enumerate(pairs) if not (links[a] and links[b])]
    count = len(chosen)
    points, frames = contact.pos[chosen], contact.frame[chosen].reshape(count, 3, 3)
    local, mine, signs = np.zeros((count, 6)), list[int](), np.ones(count)
    for row, k in enumerate(chosen):
        mujoco.mj_contactForce(built.model, data, k, local[row])
        # The frame's first row is the normal, from the first geom to the second, on which the force
        # acts; MuJoCo orders a pair by the geoms' types, so that either may be the robot.
        first, second = pairs[k]
        mine.append(second if links[second] else first)
        signs[row] = 1.0 if links[second] else -1.0
    forces = np.einsum("kij,ki->kj", frames, local[:, :3]) * signs[:, None]
    return Contacts(
        points=points,
        forces=forces,
        normals=frames[:, 0] * signs[:, None],
        feet=tuple(built.feet[g] for g in mine),
        links=tuple(links[g] for g in mine),
    )


def touched_by_links(built: Built, data: Any) -> dict[str, str]:
    """Return what links touch with anything but a sole, without any force, in order of their names.

    That is ``ground``, or a step or wall by its number. Hands and their forearms may touch walls.
    """
    links, found = built.links, dict[str, str]()
    for pair in data.contact.geom.tolist():
        touching = [one for one in pair if links[one]]
        others = [one for one in pair if not links[one]]
        leans = not built.walls.isdisjoint(pair) and not built.forearms.isdisjoint(pair)
        if len(touching) == 1 and not built.feet[touching[0]] and not leans:
            found[links[touching[0]]] = str(built.model.geom(others[0]).name)
    return dict(sorted(found.items()))


def self_contacts(built: Built, data: Any) -> tuple[tuple[str, str], ...]:
    """Return the pairs of links that touch each other."""
    pairs = ((built.links[a], built.links[b]) for a, b in data.contact.geom.tolist())
    return tuple(sorted({(min(pair), max(pair)) for pair in pairs if all(pair)}))
