"""Bounds on how far distances may end below their linear prediction over a step.

While two bodies turn against each other by an angle phi, the paths of their points curve, which is
of second order in phi, and where surfaces are parallel the nearest points jump along them, which is
of first order. Two bounds:

* of the jump, at once: phi times the length of the shorter body;
* from the corners, for the few pairs that the first leaves in doubt. Bodies are at least as far
  apart as along any direction; let the normal turn with one body. Seen from there, a corner at x
  from the nearest point of the other body ends ``m . R x >= m . x (1 - phi^2 / 2) - |x| phi`` along
  the normal m: what is not almost as near as the nearest point cannot become nearer.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wbc.robot.collision.shapes import Body, HalfSpace
from wbc.validate import Array

FEW = 8  # corners, of a capsule or a box
LEVER = 1.0  # m: on which joints carry bodies, for an estimate of curvature
Index = NDArray[np.int64]
Placements = tuple[Array, Array]  # rotations (njoints, 3, 3) and origins (njoints, 3) of all joints
Nearest = tuple[Array, Array, Array]


class CurvatureBounds:
    """Bounds on what linear predictions of some pairs' distances leave out.

    Parameters
    ----------
    pairs:
        (N, 2) indices of bodies.
    moves:
        (N, nv) 1 where a velocity moves one of a pair's bodies and not the other.

    Attributes
    ----------
    shorter:
        (N,) length of the shorter body of each pair [m].
    """

    def __init__(self, bodies: Sequence[Body], pairs: Index, moves: Array) -> None:
        self._turns = moves.copy()
        self._turns[:, :3] = 0.0  # the base's translation turns nothing
        # (N, 3), or None if the base's translation moves all bodies alike.
        self._carries = moves[:, :3].copy() if moves[:, :3].any() else None
        self._pairs = pairs
        lengths = np.array([body.length for body in bodies])
        self.shorter = lengths[pairs].min(axis=1)
        self._joints = np.array([body.joint for body in bodies])
        self._radii = np.array([body.shape.radius for body in bodies])
        flat = np.array([isinstance(body.shape, HalfSpace) for body in bodies])
        self._least = np.where(flat, np.inf, 0.0)  # half-spaces have no corners to go by
        self._counts = np.array([len(body.shape.core) for body in bodies])
        most = int(self._counts.max())
        # (bodies, 5, most): x, y, z, |x|^2, 1; those with fewer corners repeat their last.
        self._corners = np.stack([_filled(body.shape.core, most) for body in bodies])
        self._few_corners = np.ascontiguousarray(self._corners[:, :, :FEW])

    def place(self, body: int, core: Array) -> None:
        """Set the corners (k, 3) of a body of joint 0 in the world."""
        self._corners[body] = _filled(core, self._corners.shape[2])
        self._few_corners[body] = self._corners[body, :, :FEW]

    def quick(self, pairs: Index | None, step: Array) -> Array:
        """Return the bound (k,) [m] by lengths, of all pairs if None, for a ``step`` (nv,)."""
        angle, curvature = self._angles(pairs, step)
        curvature += _chosen_of(self.shorter, pairs) * angle
        return curvature

    def tight(
        self, places: Placements, pairs: Index, nearest: Nearest, step: Array, clearance: Array
    ) -> Array:
        """Return :meth:`quick`, or less from the corners where it is above ``clearance`` (k,).

        Parameters
        ----------
        nearest:
            Distances (k,), normals (k, 3) from second to first and points (k, 3) on the first.
        """
        chosen = None if len(pairs) == len(self._pairs) else pairs
        angle, curvature = self._angles(chosen, step)
        bound = _chosen_of(self.shorter, chosen) * angle
        bound += curvature
        unsure = np.flatnonzero(bound > clearance)
        if unsure.size:
            distance, normal, first = (part.take(unsure, axis=0) for part in nearest)
            contact = normal, first, first - distance[:, None] * normal
            jump = self._by_corners(places, pairs.take(unsure), contact, angle.take(unsure))
            jump += curvature.take(unsure)
            bound[unsure] = np.minimum(bound.take(unsure), jump)
        return bound

    def _by_corners(
        self, places: Placements, pairs: Index, contact: tuple[Array, ...], angle: Array
    ) -> Array:
        """Return the bound (k,) of the jump [m] from the corners of some pairs."""
        normal, first, second = contact
        bodies = self._pairs.take(pairs, axis=0).T.ravel()  # all first ones, then all second ones
        outward = np.concatenate((normal, -normal))  # away from the other body
        phi = np.concatenate((angle, angle))[:, None]
        joints = self._joints.take(bodies)
        R, origin = (part.take(joints, axis=0) for part in places)
        origin -= np.concatenate((first, second))
        origin -= self._radii.take(bodies)[:, None] * outward
        # With x = R c + origin of a corner c, m . x (1 - phi^2 / 2) and |x|^2 are linear in
        # (c, |c|^2, 1): no corner is turned.
        m = (1.0 - 0.5 * phi * phi) * outward
        factors = np.zeros((len(bodies), 2, 5))
        factors[:, 0, :3], factors[:, 1, :3] = m, 2.0 * origin
        factors[:, :, 4] = np.matmul(factors[:, :, :3], origin[:, :, None])[:, :, 0]
        factors[:, 1, 4] *= 0.5
        factors[:, :, :3] = np.matmul(factors[:, :, :3], R)
        factors[:, 1, 3] = 1.0
        counts, jumps = self._counts.take(bodies), self._least.take(bodies)
        few = counts <= FEW  # by themselves: the others' arrays are long
        for some in (np.flatnonzero(few), np.flatnonzero(~few)):
            if some.size:
                corners = self._few_corners if few[some[0]] else self._corners
                corners = corners.take(bodies.take(some), axis=0)
                ahead, lost = found = np.empty((2, len(some), corners.shape[2]))
                np.matmul(factors.take(some, axis=0), corners, out=found.transpose(1, 0, 2))
                np.sqrt(np.maximum(lost, 0.0, out=lost), out=lost)
                lost *= phi.take(some, axis=0)
                lost -= ahead
                jumps[some] = np.maximum(jumps.take(some), lost.max(axis=1))
        return np.minimum(*jumps.reshape(2, -1))

    def _angles(self, pairs: Index | None, step: Array) -> tuple[Array, Array]:
        """Return by how much pairs turn against each other (k,) [rad], how far paths curve [m]."""
        size = np.abs(step)
        angle = _chosen_of(self._turns, pairs) @ size
        lever = 0.5 * LEVER * angle
        if self._carries is not None:  # while the base slides, its turn curves the path
            lever += 0.5 * (_chosen_of(self._carries, pairs) @ size[:3])
        return angle, lever * angle


def _chosen_of(values: Array, chosen: Index | None) -> Array:
    """Return what belongs to the chosen pairs; if these are all (None), without a copy."""
    return values if chosen is None else values.take(chosen, axis=0)


def _filled(core: Array, most: int) -> Array:
    corners = core[np.minimum(np.arange(most), len(core) - 1)].T
    return np.concatenate((corners, [(corners * corners).sum(axis=0), np.ones(most)]))
