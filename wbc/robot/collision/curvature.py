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

from wbc.robot.collision.covers import chosen_of
from wbc.robot.collision.shapes import Body, HalfSpace
from wbc.validate import Array

LEVER = 1.0  # m: on which joints carry bodies, for an estimate of curvature
Index = NDArray[np.int64]
Placements = tuple[Array, Array]  # rotations (njoints, 3, 3) and origins (njoints, 3) of all joints


class CurvatureBounds:
    """Bounds on what linear predictions of some pairs' distances leave out.

    Parameters
    ----------
    pairs:
        (N, 2) indices of bodies.
    moves:
        (N, nv) 1 where a velocity moves one of a pair's bodies and not the other.
    """

    def __init__(self, bodies: Sequence[Body], pairs: Index, moves: Array) -> None:
        self._turns = moves.copy()
        self._turns[:, :3] = 0.0  # the base's translation turns nothing
        # (N, 3), or None if the base's translation moves all bodies alike.
        self._carries = moves[:, :3].copy() if moves[:, :3].any() else None
        self._pairs = pairs
        lengths = np.array([body.length for body in bodies])
        self._shorter = lengths[pairs].min(axis=1)  # (N,) length of the shorter body [m]
        self._joints = np.array([body.joint for body in bodies])
        self._radii = np.array([body.shape.radius for body in bodies])
        flat = np.array([isinstance(body.shape, HalfSpace) for body in bodies])
        self._least = np.where(flat, np.inf, 0.0)  # half-spaces have no corners to go by
        self._counts = np.array([len(body.shape.core) for body in bodies])
        most = int(self._counts.max())
        # (bodies, most, 3): those with fewer corners repeat their last.
        self._corners = np.stack([_filled(body.shape.core, most) for body in bodies])

    def place(self, body: int, core: Array) -> None:
        """Set the corners (k, 3) of a body of joint 0 in the world."""
        self._corners[body] = _filled(core, self._corners.shape[1])

    def quick(self, pairs: Index | None, step: Array) -> Array:
        """Return the bound (k,) [m] by lengths, of all pairs if None, for a ``step`` (nv,)."""
        angle, curvature = self._angles(pairs, step)
        curvature += chosen_of(self._shorter, pairs) * angle
        return curvature

    def by_corners(
        self, places: Placements, pairs: Index, contact: tuple[Array, Array, Array], step: Array
    ) -> Array:
        """Return the bound (k,) [m] from the corners of some pairs.

        Parameters
        ----------
        contact:
            Normals (k, 3) from the second to the first body, nearest points (k, 3) on both.
        """
        bound = np.empty(len(pairs))
        # Capsules by themselves: they have few corners.
        round_ones = self._counts[self._pairs.take(pairs, axis=0)].max(axis=1) <= 2
        for some in (np.flatnonzero(round_ones), np.flatnonzero(~round_ones)):
            if some.size:
                parts = tuple(part.take(some, axis=0) for part in contact)
                bound[some] = self._by_corners(places, pairs.take(some), parts, step)
        return bound

    def _by_corners(
        self, places: Placements, pairs: Index, contact: tuple[Array, ...], step: Array
    ) -> Array:
        angle, curvature = self._angles(pairs, step)
        normal, first, second = contact
        bodies = self._pairs.take(pairs, axis=0).T.ravel()  # all first ones, then all second ones
        outward = np.concatenate((normal, -normal))  # away from the other body
        joints = self._joints.take(bodies)
        R, origins = (part.take(joints, axis=0) for part in places)
        origins -= np.concatenate((first, second))
        origins -= self._radii.take(bodies)[:, None] * outward
        most = int(self._counts.take(bodies).max())
        x = np.matmul(self._corners[:, :most].take(bodies, axis=0), R.transpose(0, 2, 1))
        x += origins[:, None]
        ahead = np.matmul(x, outward[:, :, None])[:, :, 0]
        phi = np.concatenate((angle, angle))[:, None]
        ahead *= 1.0 - 0.5 * phi * phi
        lost = phi * np.sqrt(np.einsum("kci,kci->kc", x, x))
        lost -= ahead
        jumps = np.maximum(lost.max(axis=1), self._least.take(bodies)).reshape(2, -1)
        curvature += np.minimum(*jumps)
        return curvature

    def _angles(self, pairs: Index | None, step: Array) -> tuple[Array, Array]:
        """Return by how much pairs turn against each other (k,) [rad], how far paths curve [m]."""
        size = np.abs(step)
        angle = chosen_of(self._turns, pairs) @ size
        lever = 0.5 * LEVER * angle
        if self._carries is not None:  # while the base slides, its turn curves the path
            lever += 0.5 * (chosen_of(self._carries, pairs) @ size[:3])
        return angle, lever * angle


def _filled(core: Array, most: int) -> Array:
    return core[np.minimum(np.arange(most), len(core) - 1)]
