"""Pairs of bodies: the nearest, their distances, and how these change with the velocity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError
from wbc.robot.collision.curvature import CurvatureBounds
from wbc.robot.collision.distances import ShapePairs, nearest_points
from wbc.robot.collision.fitting import quick_capsule
from wbc.robot.collision.shapes import Body, Capsule, HalfSpace, Hull, Shape
from wbc.robot.model import Robot, Snapshot
from wbc.validate import Array, finite_array, read_only

Index = NDArray[np.int64]
Scalar = TypeVar("Scalar", bound=np.generic)
# Pairs looked at for each pair asked for: bounding balls say little about long shapes.
CANDIDATES = 3
# Of these, pairs measured where that needs GJK (1.5 us each): capsules round the shapes say more.
NARROWED = 2


class PairDistances(NamedTuple):
    """Distances, normals and nearest points of k pairs of bodies.

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
    snapshot:
        The state they were measured in.
    """

    pairs: Index
    distance: Array
    normal: Array
    point: Array
    snapshot: Snapshot


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
        self._every: Index = np.arange(len(self.pairs))
        self._every.flags.writeable = False
        self._first, self._second = self.pairs[:, 0].copy(), self.pairs[:, 1].copy()
        if (joints[self._first] == joints[self._second]).any():
            k = int(np.flatnonzero(joints[self._first] == joints[self._second])[0])
            raise InvalidInputError(f"pair {self.labels[k]!r}: both are on one joint")
        covers = [_cover(body.shape) for body in self.bodies]
        self._own = [_columns(*both) for both in zip(self.bodies, covers, strict=True)]
        self._local = np.stack(self._own)  # (bodies, 3, 3)
        radii = np.array([cover.radius for cover in covers])
        lengths = np.array([_length(cover) for cover in covers])
        reach = np.array([body.bounding_ball[1] for body in self.bodies])
        self._reaches = reach[self._first] + reach[self._second]
        self._thickness = radii[self._first] + radii[self._second]
        self._first_radius = radii[self._first]
        self._length_a, self._length_b = lengths[self._first], lengths[self._second]
        self._flat_index = self._first * len(self.bodies) + self._second
        moves = _moved_by(robot)
        # What turns the first body away from the second: joints below both move neither.
        self._signs = moves[joints[self._first]] - moves[joints[self._second]]  # (pairs, nv)
        self._curvature = CurvatureBounds(self.bodies, self.pairs, np.abs(self._signs))
        flat = np.array([isinstance(body.shape, HalfSpace) for body in self.bodies])
        if flat[self._first].any():
            raise InvalidInputError("pairs: a half-space must be the second of a pair")
        self._flat = np.flatnonzero(flat[self._second])
        # Pairs of capsules are measured as segments, the others by coal.
        solid = np.array([not isinstance(body.shape, Capsule) for body in self.bodies])
        self._solid = solid[self.pairs].any(axis=1)  # (pairs,)
        self._solid_number = np.cumsum(self._solid) - 1
        self._solids = None
        if self._solid.any():
            self._solids = ShapePairs(robot, self.bodies, self.pairs[self._solid])

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
        self._local[body] = R @ self._own[body]
        self._local[body, :, 0] += p
        self._local[body, :, 2] += p
        self._curvature.place(body, self.bodies[body].shape.core @ R.T + p)
        if self._solids is not None:
            self._solids.place(body, (R, p))

    def measure(self, snapshot: Snapshot, pairs: Index) -> PairDistances:
        """Return the distances of some pairs, given by their numbers, increasing."""
        return self._nearest(snapshot, None, pairs, len(pairs))

    def nearest(self, snapshot: Snapshot, count: int | None = None) -> PairDistances:
        """Return the ``count`` nearest pairs, or all, in the order of :attr:`pairs`."""
        if count is not None and count < 1:
            raise InvalidInputError(f"nearest, count: at least 1, got {count}")
        total = len(self.pairs)
        count = total if count is None else min(count, total)
        tried = CANDIDATES * count
        if tried >= total:
            return self._nearest(snapshot, None, self._every, count)
        placed = self._placed(snapshot)
        lower = self._lower_bounds(placed)
        order = np.argpartition(lower, tried)
        near = order[:tried]
        near.sort()
        found = self._nearest(snapshot, placed, near, count)
        farthest = np.maximum.reduce(found.distance)
        if lower[order[tried]] >= farthest:
            return found
        left = order[tried:]  # one that was left out may be nearer
        more = np.sort(left[lower[left] < farthest])
        return _merged(found, self._nearest(snapshot, placed, more, count, float(farthest)), count)

    def rows(self, snapshot: Snapshot, found: PairDistances) -> Array:
        """Return the derivative (k, nv) of the distances by the velocity.

        The normal n through both nearest points is a line of force: with the twists J of the
        joints at the world's origin, d(distance)/dt = [n, p x n] J v over the joints that move one
        body and not the other. No joint is looked at by itself.
        """
        n, p = found.normal.T, found.point.T
        line = np.empty((6, len(found.pairs)))
        line[:3] = n
        n, p = np.concatenate((n, n)), np.concatenate((p, p))  # x y z x y z
        arm = np.multiply(p[1:4], n[2:5], out=line[3:])
        arm -= p[2:5] * n[1:4]
        matrix = line.T @ snapshot.joint_twists
        matrix *= self._of(self._signs, found.pairs)
        return matrix

    def curvature_bound(self, pairs: Index, step: Array) -> Array:
        """Return how far (k,) the distances may end below their linear prediction [m].

        Over a displacement ``step`` (nv,) the two bodies turn against each other by at most the sum
        of the angles between them. That curves the paths of their points, and where surfaces are
        parallel the nearest points may jump along the shorter one; see ``curvature``.
        """
        return self._curvature.quick(None if pairs is self._every else pairs, step)

    def tight_curvature_bound(self, found: PairDistances, step: Array, clearance: Array) -> Array:
        """Return :meth:`curvature_bound`, more closely where it is above ``clearance`` (k,).

        Only surfaces that are parallel and near each other keep the first bound.
        """
        bound = self.curvature_bound(found.pairs, step)
        unsure = np.flatnonzero(bound > clearance)
        if unsure.size:
            pairs = found.pairs.take(unsure)
            normal, point = found.normal.take(unsure, axis=0), found.point.take(unsure, axis=0)
            contact = normal, point, point - found.distance.take(unsure)[:, None] * normal
            places = found.snapshot.joint_placements
            tight = self._curvature.by_corners(places, pairs, contact, step)
            bound[unsure] = np.minimum(bound[unsure], tight)
        return bound

    def _of(self, values: NDArray[Scalar], pairs: Index) -> NDArray[Scalar]:
        """Return what belongs to some pairs; without a copy if these are all."""
        return values if pairs is self._every else values.take(pairs, axis=0)

    def _placed(self, snapshot: Snapshot) -> Array:
        """Return start, direction and middle of all bodies, (3, 3, bodies), world axes.

        Bodies come last: NumPy is quickest along the long side.
        """
        R, p = snapshot.joint_placements
        turned = np.matmul(R.take(self._joints, axis=0), self._local)
        placed = np.ascontiguousarray(turned.T)
        placed[::2] += p.take(self._joints, axis=0).T
        return placed

    def _lower_bounds(self, placed: Array) -> Array:
        """Return the distance (pairs,) of the balls that hold the bodies, or of ball and plane."""
        middles = placed[2] - placed[2, :, :1]  # from near by: no cancellation far away
        products = middles.T @ middles
        squares = products.diagonal()
        apart = squares[:, None] + squares
        products *= 2.0
        apart -= products
        bounds = apart.take(self._flat_index)
        np.maximum(bounds, 0.0, out=bounds)
        np.sqrt(bounds, out=bounds)
        bounds -= self._reaches
        if self._flat.size:
            planes, bodies = self._second[self._flat], self._first[self._flat]
            above = placed[2, :, bodies] - placed[0, :, planes]  # (k, 3)
            heights = np.einsum("ki,ki->k", above, placed[1, :, planes])
            bounds[self._flat] = heights - self._reaches[self._flat]
        return bounds

    def _nearest(
        self,
        snapshot: Snapshot,
        placed: Array | None,
        tried: Index,
        count: int,
        farthest: float = np.inf,
    ) -> PairDistances:
        """Return the ``count`` nearest of the pairs ``tried``, or all, measured exactly.

        Those beyond ``farthest`` need not be exact.
        """
        solids, solid = self._solids, self._solid.take(tried)
        some = count < len(tried)
        if solids is not None and not some and solid.all():
            numbers = self._solid_number.take(tried)
            distance = solids.distances(snapshot, numbers)
            normal, point = solids.witnesses(numbers)
            return PairDistances(tried, distance, normal.T, point.T, snapshot)
        placed = self._placed(snapshot) if placed is None else placed
        distance, normal, point = self._capsules(placed, tried)
        if solids is not None and solid.any():
            solid = self._measured(snapshot, tried, distance, solid, count, farthest)
        if some:
            best = _smallest(distance, count)
            tried, distance, solid = tried.take(best), distance.take(best), solid.take(best)
            normal, point = normal.take(best, axis=1), point.take(best, axis=1)
        where = np.flatnonzero(solid)
        if solids is not None and where.size:
            numbers = self._solid_number.take(tried.take(where))
            normal[:, where], point[:, where] = solids.witnesses(numbers)
        return PairDistances(tried, distance, normal.T, point.T, snapshot)

    def _measured(
        self,
        snapshot: Snapshot,
        tried: Index,
        distance: Array,
        solid: NDArray[np.bool_],
        count: int,
        farthest: float,
    ) -> NDArray[np.bool_]:
        """Replace capsules' distances by those of the shapes inside, where these may be nearest.

        First those nearest by their capsules, then what may still be among the ``count`` nearest.
        Returns which were measured.
        """
        assert self._solids is not None
        if self._flat.size:
            distance[np.isin(tried, self._flat)] = -np.inf  # nothing is round a plane
        done = np.zeros_like(solid)
        reach, first = farthest, NARROWED * count
        if first < len(tried):
            reach = min(farthest, float(np.partition(distance, first)[first]))
        while True:
            where = np.flatnonzero(solid & ~done & (distance <= reach))
            if where.size:
                numbers = self._solid_number.take(tried.take(where))
                distance[where] = self._solids.distances(snapshot, numbers)
                done[where] = True
            if count >= len(tried) or (not where.size and first < 0):
                return done
            reach = min(farthest, float(np.partition(distance, count - 1)[count - 1]))
            first = -1

    def _capsules(self, placed: Array, chosen: Index) -> tuple[Array, Array, Array]:
        """Return distances (k,), normals (3, k) and points on the first bodies (3, k).

        Those of the capsules round the shapes, if these are others.
        """
        first, second = self._of(self._first, chosen), self._of(self._second, chosen)
        axes = nearest_points(
            placed.take(first, axis=2),
            placed.take(second, axis=2),
            self._of(self._length_a, chosen),
            self._of(self._length_b, chosen),
        )
        distance, normal, point = axes
        distance -= self._of(self._thickness, chosen)
        point -= self._of(self._first_radius, chosen) * normal
        return distance, normal, point


def _merged(one: PairDistances, two: PairDistances, count: int) -> PairDistances:
    """Return the ``count`` nearest of both, in the order of the pairs."""
    distance = np.concatenate((one.distance, two.distance))
    pairs = np.concatenate((one.pairs, two.pairs))
    best = _smallest(distance, count)
    best = best[np.argsort(pairs.take(best))]
    normal = np.concatenate((one.normal, two.normal)).take(best, axis=0)
    point = np.concatenate((one.point, two.point)).take(best, axis=0)
    return PairDistances(pairs.take(best), distance.take(best), normal, point, one.snapshot)


def _smallest(values: Array, count: int) -> Index:
    """Return where the ``count`` smallest values are, increasing."""
    places = np.argpartition(values, count)[:count]
    places.sort()
    return places


def _cover(shape: Shape) -> Capsule:
    """Return a capsule that holds a shape; of a half-space, a point of its surface."""
    match shape:
        case Capsule():
            return shape
        case Hull():
            capsule = quick_capsule(shape.vertices)
            return Capsule(capsule.ends, capsule.radius + shape.radius)
    return Capsule.sphere(shape.core[0], 0.0)


def _length(capsule: Capsule) -> float:
    return float(np.linalg.norm(capsule.ends[1] - capsule.ends[0]))


def _columns(body: Body, cover: Capsule) -> Array:
    """Return start, unit direction and middle (3, 3) of a body in its frame, in columns.

    Start and direction are those of its cover; the direction of a half-space is its normal.
    """
    if isinstance(body.shape, HalfSpace):
        point = body.shape.core[0]
        return np.stack((point, body.shape.normal, point), axis=1)
    start, end = cover.ends
    direction = (end - start) / (_length(cover) or 1.0)
    middle, _ = body.bounding_ball
    return np.stack((start, direction, middle), axis=1)


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
