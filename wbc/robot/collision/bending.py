"""How far distances may end below their linear prediction over a step that turns bodies.

While two bodies turn against each other by an angle phi, the paths of their points bend, which is
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

REACH = 1.0  # m: levers on which joints carry bodies, for an estimate of curvature
Index = NDArray[np.int64]
Places = tuple[Array, Array]  # rotations (njoints, 3, 3) and origins (njoints, 3) of all joints


class Bending:
    """Bounds on what linear predictions of some pairs' distances leave out.

    Parameters
    ----------
    pairs:
        (N, 2) indices of bodies.
    moves:
        (N, nv) 1 where a velocity moves one of a pair's bodies and not the other.

    Attributes
    ----------
    turns:
        (N, nv) ``moves`` without the base's translation, which turns nothing.
    carries:
        (N, 3) ``moves`` of the base's translation alone; None if it moves all bodies alike.
    slides:
        (N,) length of the shorter body [m].
    """

    def __init__(self, bodies: Sequence[Body], pairs: Index, moves: Array) -> None:
        self.turns = moves.copy()
        self.turns[:, :3] = 0.0
        self.carries = moves[:, :3].copy() if moves[:, :3].any() else None
        self._pairs = pairs
        lengths = np.array([body.length for body in bodies])
        self.slides = lengths[pairs].min(axis=1)
        self._joints = np.array([body.joint for body in bodies])
        self._radii = np.array([body.shape.radius for body in bodies])
        flat = np.array([isinstance(body.shape, HalfSpace) for body in bodies])
        self._least = np.where(flat, np.inf, 0.0)  # planes have no corners to go by
        most = max(len(body.shape.core) for body in bodies)
        # (bodies, most, 3): those with fewer corners repeat their last.
        self._corners = np.stack([_filled(body.shape.core, most) for body in bodies])

    def place(self, body: int, core: Array) -> None:
        """Say where the corners (k, 3) of a body of joint 0 are now."""
        self._corners[body] = _filled(core, self._corners.shape[1])

    def from_corners(
        self, places: Places, pairs: Index, contact: tuple[Array, Array, Array], angle: Array
    ) -> Array:
        """Return what the corners of some pairs may come nearer by (k,) without the path's bend.

        Parameters
        ----------
        contact:
            Normals (k, 3) from the second to the first body, nearest points (k, 3) on both.
        angle:
            (k,) by which the two turn against each other at most [rad].
        """
        normal, first, second = contact
        bodies = self._pairs.take(pairs, axis=0).T.ravel()  # all first ones, then all second ones
        outward = np.concatenate((normal, -normal))  # away from the other body
        surface = np.concatenate((first, second))
        joints = self._joints.take(bodies)
        R, origins = (part.take(joints, axis=0) for part in places)
        origins -= surface
        origins -= self._radii.take(bodies)[:, None] * outward
        x = np.matmul(self._corners.take(bodies, axis=0), R.transpose(0, 2, 1))
        x += origins[:, None]
        ahead = np.matmul(x, outward[:, :, None])[:, :, 0]
        phi = np.concatenate((angle, angle))[:, None]
        ahead *= 1.0 - 0.5 * phi * phi
        lost = phi * np.sqrt(np.einsum("kci,kci->kc", x, x))
        lost -= ahead
        jumps = np.maximum(lost.max(axis=1), self._least.take(bodies)).reshape(2, -1)
        return np.asarray(np.minimum(*jumps))


def _filled(core: Array, most: int) -> Array:
    return core[np.minimum(np.arange(most), len(core) - 1)]
