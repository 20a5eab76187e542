"""Bodies and pairs of them: which are nearest, how near, and how that changes with the velocity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError
from wbc.robot.collision.hulls import SolidPairs
from wbc.robot.collision.segments import Nearest, nearest_points
from wbc.robot.collision.shapes import Body, Capsule, HalfSpace
from wbc.robot.model import Robot
from wbc.robot.snapshot import Snapshot
from wbc.validate import Array, finite_array, read_only

Index = NDArray[np.int64]
# Pairs measured exactly for each pair asked for: bounding balls say little about long shapes.
CANDIDATES = 3
REACH = 1.0  # m: levers on which joints carry bodies, for an estimate of curvature


class Proximity(NamedTuple):
    """How near the bodies of k pairs are.

    Attributes
    ----------
    pairs:
        (k,) which of the model's pairs, increasing.
    distance:
        (k,) between the surfaces [m], negative where they overlap.
    normal:
        (k, 3) unit vectors from the second body to the first, world axes.
    point:
        (k, 3) on the surface of the first body; that of the second is ``point - distance normal``.
    """

    pairs: Index
    distance: Array
    normal: Array
    point: Array


class CollisionModel:
    """Bodies on a robot, and some at rest or moved from outside, with the pairs to be kept apart.

    Parameters
    ----------
    bodies:
        Those of joint 0 do not hang on the robot; see :meth:`place`.
    pairs:
        Pairs of indices of bodies, not both on one joint.

    Attributes
    ----------
    labels:
        One for each pair, such as ``"left_hand vs pelvis"``.
    """

    def __init__(
        self, robot: Robot, bodies: Sequence[Body], pairs: Sequence[tuple[int, int]]
    ) -> None:
        self.robot = robot
        self.bodies = tuple(bodies)
        self.pairs: Index = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        names = [body.name for body in self.bodies]
        self.labels = tuple(f"{names[a]} vs {names[b]}" for a, b in self.pairs)
        joints = np.array([body.joint for body in self.bodies], dtype=np.int64)
        self._joints = joints
        self._first, self._second = self.pairs[:, 0].copy(), self.pairs[:, 1].copy()
        if (joints[self._first] == joints[self._second]).any():
            k = int(np.flatnonzero(joints[self._first] == joints[self._second])[0])
            raise InvalidInputError(f"pair {self.labels[k]!r}: both are on one joint")
        self._local = np.stack([_columns(body) for body in self.bodies])  # (bodies, 3, 3)
        self._radii = np.array([body.shape.radius for body in self.bodies])
        reach = np.array([body.ball[1] for body in self.bodies])
        self._reaches = reach[self._first] + reach[self._second]
        self._thickness = self._radii[self._first] + self._radii[self._second]
        lengths = np.array([body.length for body in self.bodies])
        squared = np.where(np.isfinite(lengths) & (lengths > 0.0), lengths, np.inf) ** 2
        self._shrink_a, self._shrink_b = 1.0 / squared[self._first], 1.0 / squared[self._second]
        self._flat_index = self._first * len(self.bodies) + self._second
        moves = _moved_by(robot)
        # What turns the first body away from the second: joints below both move neither.
        self._signs = moves[joints[self._first]] - moves[joints[self._second]]  # (pairs, nv)
        self._turns = np.abs(self._signs)
        self._turns[:, :3] = 0.0  # the base's translation turns nothing
        self._slides = np.minimum(lengths[self._first], lengths[self._second])
        self._split()

    def _split(self) -> None:
        """Tell the pairs that need coal from those of two capsules."""
        flat = np.array([isinstance(body.shape, HalfSpace) for body in self.bodies])
        if flat[self._first].any():
            raise InvalidInputError("pairs: a half-space must be the second of a pair")
        self._flat = np.flatnonzero(flat[self._second])
        hull = np.array([not isinstance(body.shape, Capsule) for body in self.bodies])
        solid = hull[self._first] | hull[self._second]
        self._solid = solid if solid.any() else None
        self._rank = np.cumsum(solid) - 1  # a pair's number among those that need coal
        self._solids = SolidPairs(self.bodies, self.pairs[solid]) if solid.any() else None

    def __repr__(self) -> str:
        return (
            f"CollisionModel({self.robot.name}, bodies={len(self.bodies)}, pairs={len(self.pairs)})"
        )

    def place(self, body: int, rotation: Array, origin: Array) -> None:
        """Move a body of joint 0: its shape's frame is put at ``rotation``, ``origin`` (world)."""
        if self._joints[body] != 0:
            raise InvalidInputError(f"body {self.bodies[body].name!r} is moved by the robot")
        R = finite_array("rotation", rotation, (3, 3))
        p = finite_array("origin", origin, (3,))
        local = _columns(self.bodies[body])
        self._local[body] = R @ local
        self._local[body, :, 0] += p
        self._local[body, :, 2] += p
        if self._solids is not None:
            self._solids.place(body, (R, p))

    def measure(self, snapshot: Snapshot, pairs: Index) -> Proximity:
        """Return how near the bodies of some pairs are, given by their numbers, increasing."""
        return self._nearest(snapshot, self._placed(snapshot), pairs, len(pairs))

    def nearest(self, snapshot: Snapshot, count: int | None = None) -> Proximity:
        """Return the ``count`` nearest pairs, or all, in the order of :attr:`pairs`."""
        placed = self._placed(snapshot)
        total = len(self.pairs)
        count = total if count is None else min(count, total)
        tried = CANDIDATES * count
        if tried >= total:
            return self._nearest(snapshot, placed, np.arange(total), count)
        lower = self._lower_bounds(placed)
        order = np.argpartition(lower, tried)
        candidates = order[:tried]
        candidates.sort()
        found = self._nearest(snapshot, placed, candidates, count)
        farthest = np.maximum.reduce(found.distance)
        if lower[order[tried]] < farthest:  # one that was left out may be nearer
            left = order[tried:]
            more = np.concatenate((found.pairs, left[lower[left] < farthest]))
            more.sort()
            return self._nearest(snapshot, placed, more, count)
        return found

    def rows(self, snapshot: Snapshot, found: Proximity) -> Array:
        """Return the derivative (k, nv) of the distances by the velocity.

        The normal n through both nearest points is a line of force: with the twists J of the
        joints at the world's origin, d(distance)/dt = [n, p x n] J v over the joints that move one
        body and not the other. No joint is looked at by itself.
        """
        n, p = found.normal, found.point
        line = np.empty((len(n), 6))
        line[:, :3] = n
        n0, n1, n2 = n.T
        p0, p1, p2 = p.T
        line[:, 3] = p1 * n2 - p2 * n1
        line[:, 4] = p2 * n0 - p0 * n2
        line[:, 5] = p0 * n1 - p1 * n0
        matrix = line @ snapshot.joint_twists
        matrix *= self._signs.take(found.pairs, axis=0)
        return matrix

    def bend(self, pairs: Index, step: Array) -> Array:
        """Return how far (k,) the distances may end below their linear prediction [m].

        Over a displacement ``step`` (nv,) the two bodies turn against each other by at most the sum
        of the angles between them. That bends the paths of their points, and where surfaces are
        parallel the nearest points may jump along the shorter one.
        """
        angle = self._turns.take(pairs, axis=0) @ np.abs(step)
        return angle * (self._slides.take(pairs) + 0.5 * REACH * angle)

    def _placed(self, snapshot: Snapshot) -> Array:
        """Return start, direction and middle (bodies, 3, 3) of all bodies, in columns, world."""
        R, p = snapshot.joint_placements
        placed = np.matmul(R.take(self._joints, axis=0), self._local)
        origins = p.take(self._joints, axis=0)
        placed[:, :, 0] += origins
        placed[:, :, 2] += origins
        return placed

    def _lower_bounds(self, placed: Array) -> Array:
        """Return the distance (pairs,) of the balls that hold the bodies, or of ball and plane."""
        middles = placed[:, :, 2] - placed[0, :, 2]  # from near by: no cancellation far away
        products = middles @ middles.T
        squares = products.diagonal()
        apart = squares[:, None] + squares
        products *= 2.0
        apart -= products
        bounds = apart.take(self._flat_index)
        np.maximum(bounds, 0.0, out=bounds)
        np.sqrt(bounds, out=bounds)
        bounds -= self._reaches
        if self._flat.size:
            plane = placed[self._second[self._flat]]
            above = placed[self._first[self._flat], :, 2] - plane[:, :, 0]
            heights = np.einsum("ki,ki->k", above, plane[:, :, 1])
            bounds[self._flat] = heights - self._reaches[self._flat]
        return bounds

    def _nearest(self, snapshot: Snapshot, placed: Array, tried: Index, count: int) -> Proximity:
        """Return the ``count`` nearest of the pairs ``tried``, measured exactly."""
        if self._solids is None or self._solid is None:
            return _best(tried, self._capsules(placed, tried), count)
        solid = self._solid.take(tried)
        mixed = not solid.all()
        distance = np.empty(len(tried))
        distance[solid] = self._solids.distances(snapshot, self._rank.take(tried[solid]))
        round_ones = self._capsules(placed, tried[~solid]) if mixed else None
        if round_ones is not None:
            distance[~solid] = round_ones.distance
        best = _smallest(distance, count)
        chosen, kind = tried[best], solid[best]
        normal, point = np.empty((len(best), 3)), np.empty((len(best), 3))
        normal[kind], point[kind] = self._solids.witnesses(self._rank.take(chosen[kind]))
        if round_ones is not None:
            place = (np.cumsum(~solid) - 1)[best[~kind]]
            normal[~kind], point[~kind] = round_ones.normal[place], round_ones.point[place]
        return Proximity(chosen, distance[best], normal, point)

    def _capsules(self, placed: Array, chosen: Index) -> Nearest:
        first, second = self._first.take(chosen), self._second.take(chosen)
        axes = nearest_points(
            placed.take(first, axis=0),
            placed.take(second, axis=0),
            self._shrink_a.take(chosen),
            self._shrink_b.take(chosen),
        )
        surface = axes.point - self._radii.take(first)[:, None] * axes.normal
        return Nearest(axes.distance - self._thickness.take(chosen), axes.normal, surface)


def _best(tried: Index, found: Nearest, count: int) -> Proximity:
    """Return the ``count`` nearest of capsules that were measured, order unchanged."""
    if count >= len(tried):
        return Proximity(tried, *found)
    best = _smallest(found.distance, count)
    distance, normal, point = (part.take(best, axis=0) for part in found)
    return Proximity(tried.take(best), distance, normal, point)


def _smallest(values: Array, count: int) -> Index:
    """Return where the ``count`` smallest values are, increasing."""
    if count >= len(values):
        return np.arange(len(values))
    places = np.argpartition(values, count)[:count]
    places.sort()
    return places


def _columns(body: Body) -> Array:
    """Return start, direction and middle (3, 3) of a body in its frame, in columns.

    Those of a half-space are a point of its surface, its normal, and the point again.
    """
    if isinstance(body.shape, HalfSpace):
        point = body.shape.core[0]
        return np.stack((point, body.shape.normal, point), axis=1)
    ends = body.shape.core[[0, -1]]
    middle, _ = body.ball
    return np.stack((ends[0], ends[1] - ends[0], middle), axis=1)


def _moved_by(robot: Robot) -> Array:
    """Return (njoints, nv): 1 where a velocity moves the body of a joint, else 0."""
    model = robot.model
    moves = np.zeros((model.njoints, model.nv))
    for joint in range(1, model.njoints):
        for above in model.supports[joint]:
            if above > 0:
                start = model.idx_vs[above]
                moves[joint, start : start + model.nvs[above]] = 1.0
    return read_only(moves)
