"""Pairs of bodies: the nearest, their distances, and how these change with the velocity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError
from wbc.robot.collision.closing import BodyMotion, Closing
from wbc.robot.collision.covers import Covers, chosen_of
from wbc.robot.collision.curvature import CurvatureBounds
from wbc.robot.collision.distances import ShapePairs, parts
from wbc.robot.collision.native_pairs import NativePairs
from wbc.robot.collision.shapes import Body, Capsule, HalfSpace
from wbc.robot.model import Robot, Snapshot
from wbc.validate import Array, finite_array, read_only

Index = NDArray[np.int64]
# Pairs looked at for each pair asked for: bounding balls say little about long shapes, and where
# most shapes are no capsules, the capsules round them say no more than which to measure.
CANDIDATES, CANDIDATES_OF_SOLIDS = 3, 5
# Pairs measured at once for each asked for, where that needs GJK (1.5 us each).
NARROWED = 3
# Where many bodies touch the core is asked for so many times as many, before it is coal that
# measures all: how deep these are, the core does not know, so that others may be nearer.
MORE = 4
EVEN = 1e-9  # m: of pairs that have as much left, the first by their number


class PairDistances(NamedTuple):
    """Distances, normals and nearest points of k pairs of bodies."""

    pairs: Index  # (k,) which of the model's pairs, increasing
    distance: Array  # (k,) between the surfaces [m], negative where they overlap
    normal: Array  # (k, 3) unit vectors from the second body to the first, world axes
    # (k, 3) on the surface of the first body; that of the second is point - distance normal.
    point: Array
    snapshot: Snapshot  # the state they were measured in

    def take(self, chosen: Index) -> PairDistances:
        """Return some of them, by their places here."""
        pairs, normal, point = self.pairs[chosen], self.normal[chosen], self.point[chosen]
        return PairDistances(pairs, self.distance[chosen], normal, point, self.snapshot)


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
        first, second = self.pairs.T
        same = np.flatnonzero(joints[first] == joints[second])
        if same.size:
            k = int(same[0])
            raise InvalidInputError(f"pair {self.labels[k]!r}: both are on one joint")
        self._moves = moves = _moved_by(robot)
        # What turns the first body away from the second: joints below both move neither.
        self._signs = moves[joints[first]] - moves[joints[second]]  # (pairs, nv)
        self._curvature = CurvatureBounds(self.bodies, self.pairs, np.abs(self._signs))
        if any(isinstance(self.bodies[k].shape, HalfSpace) for k in first.tolist()):
            raise InvalidInputError("pairs: a half-space must be the second of a pair")
        self._covers = Covers(self.bodies, self.pairs)
        # Pairs of capsules are measured as segments, the others by coal.
        other = np.array([not isinstance(body.shape, Capsule) for body in self.bodies])
        solid = np.logical_or(other[first], other[second])  # (pairs,)
        self._solid_number = np.where(solid, np.cumsum(solid) - 1, -1)  # (pairs,)
        self._every_solid = np.flatnonzero(solid), np.arange(np.count_nonzero(solid))
        most = 2 * np.count_nonzero(solid) > len(solid)
        self._candidates = CANDIDATES_OF_SOLIDS if most else CANDIDATES
        self._solids = ShapePairs(robot, self.bodies, self.pairs[solid]) if solid.any() else None
        self._native = None  # the core knows no half-spaces
        self._many_touch = 0
        if not self._covers.flat.size:
            parents = [0, *map(int, list(robot.model.parents)[1:])]
            self._native = NativePairs(self._covers, self.bodies, self.pairs, solid, parents)

    def __repr__(self) -> str:
        return (
            f"CollisionModel({self.robot.name}, bodies={len(self.bodies)}, pairs={len(self.pairs)})"
        )

    @property
    def native(self) -> NativePairs | None:
        """The pairs as the native core reads them; None: there are half-spaces."""
        return self._native

    @property
    def shorter(self) -> Array:
        """Length of the shorter body of each pair (N,) [m]."""
        return self._curvature.shorter

    def place(self, body: int, rotation: Array, origin: Array) -> None:
        """Move a body of joint 0: its shape's frame is put at ``rotation``, ``origin`` (world)."""
        if self._joints[body] != 0:
            raise InvalidInputError(f"body {self.bodies[body].name!r} is moved by the robot")
        R = finite_array("rotation", rotation, (3, 3))
        p = finite_array("origin", origin, (3,))
        self._covers.place(body, R, p)
        core = self.bodies[body].shape.core @ R.T + p
        self._curvature.place(body, core)
        if self._native is not None:
            self._native.place(body, core)
        if self._solids is not None:
            self._solids.place(body, (R, p))

    def measure(self, snapshot: Snapshot, pairs: Index) -> PairDistances:
        """Return the distances of some pairs, given by their numbers, increasing."""
        if self._native is not None and snapshot.native_state is not None:
            found = self._native.measure(snapshot.native_state, pairs)
            if found is not None:
                self._fill_in(snapshot, pairs, found)
                return _pair_distances(snapshot, pairs, found)
        return _pair_distances(snapshot, *self._measured(snapshot, None, pairs, len(pairs)))

    def nearest(
        self, snapshot: Snapshot, count: int | None = None, kept: Array | None = None
    ) -> PairDistances:
        """Return the ``count`` nearest pairs, or all, in the order of :attr:`pairs`.

        ``kept`` (N,) is what each pair keeps: those are nearest whose distance is least above it.
        """
        if count is not None and count < 1:
            raise InvalidInputError(f"nearest, count: at least 1, got {count}")
        total = len(self.pairs)
        count = total if count is None else min(count, total)
        if self._native is not None and snapshot.native_state is not None and total:
            # As bodies touch for many ticks, what was too few is not asked for first again.
            for most in (count, min(MORE * count, total))[self._many_touch :]:
                nearest = self._native.nearest(snapshot.native_state, most, kept)
                if nearest is None:
                    continue
                touching = np.count_nonzero(nearest[1][0] == -np.inf)
                if most < total and MORE * touching > most:
                    continue  # coal takes as long for them as the core for all
                known = self._fill_in(snapshot, *nearest)
                found = _pair_distances(snapshot, *nearest)
                left = _above(found, kept)
                # Of those that the core measured, none that it left out is nearer.
                if known.all() or left[known].max(initial=-np.inf) >= _smallest(left, count):
                    self._many_touch = int(MORE * touching > count)
                    return _fewest(found, count, kept)
        if kept is None:
            return self._nearest(snapshot, count)
        # Pairs are found by distance: so many may be nearer than one of less clearance.
        closer = int(np.count_nonzero(kept < kept.max(initial=0.0)))
        return _fewest(self._nearest(snapshot, min(count + closer, total)), count, kept)

    def soonest(
        self, snapshot: Snapshot, count: int, kept: Array, closing: Closing
    ) -> tuple[PairDistances, Array]:
        """Return the pairs that have to brake first, in order, and what they have left (k,) [m].

        That is what is above the distance ``kept`` (N,) less the way in which they stop. Of all
        pairs, ``count`` of those with the least, and all that have less than nothing. Which to
        measure is found by balls round the bodies and bounds on the speed of their points, which
        no pair's clearance and closing is worse than.
        """
        total = len(self.pairs)
        count = min(count, total)
        motion = BodyMotion(snapshot, self._joints, self._moves)
        placed = self._covers.placed(snapshot)
        speed = motion.most(placed[2].T, self._covers.sizes[:, 2])
        lower = self._covers.balls(placed)
        first, second = self.pairs.T
        lower -= kept + closing.way(speed.take(first) + speed.take(second))
        limit = max(0.0, _smallest(lower, count))
        while True:
            found = self.measure(snapshot, np.flatnonzero(lower <= limit))
            speed = motion.closing(self.pairs.take(found.pairs, axis=0), found.normal, found.point)
            left = found.distance - kept.take(found.pairs) - closing.way(speed)
            farthest = max(0.0, _smallest(left, count))
            if farthest <= limit or len(found.pairs) == total:
                break
            limit = farthest
        last = _smallest(left, count)
        first = left < last - EVEN
        last_ones = np.flatnonzero(~first & (left <= last + EVEN))
        first[last_ones[: count - np.count_nonzero(first)]] = True
        chosen = np.flatnonzero(first | (left < 0.0))
        return found.take(chosen), left.take(chosen)

    def _fill_in(self, snapshot: Snapshot, pairs: Index, found: Array) -> NDArray[np.bool_]:
        """Measure what the core could not; return which (k,) it could."""
        known = found[0] > -np.inf
        if self._solids is not None and not known.all():
            solids = self._solid_number.take(pairs[~known])
            found[:, ~known] = self._solids.measure(snapshot, solids)
        return known

    def _nearest(self, snapshot: Snapshot, count: int) -> PairDistances:
        """Return the nearest pairs, by arrays and coal."""
        total = len(self.pairs)
        tried = self._candidates * count
        if tried >= total:
            return _pair_distances(snapshot, *self._measured(snapshot, None, self._every, count))
        placed = self._covers.placed(snapshot)
        lower = self._covers.balls(placed)
        order = lower.argpartition(tried)
        near = order[:tried]
        near.sort()
        pairs, found = self._measured(snapshot, placed, near, count)
        farthest = float(np.maximum.reduce(found[0]))
        if lower[order[tried]] < farthest:  # one that was left out may be nearer
            left = order[tried:]
            more = self._measured(snapshot, placed, left[lower[left] < farthest], count, farthest)
            both = np.concatenate((pairs, more[0])), np.concatenate((found, more[1]), axis=1)
            pairs, found = _least(*both, count)
        return _pair_distances(snapshot, pairs, found)

    def rows(self, snapshot: Snapshot, found: PairDistances) -> Array:
        """Return the derivative (k, nv) of the distances by the velocity.

        The normal n through both nearest points is a line of force: with the twists J of the
        joints at the world's origin, d(distance)/dt = [n, p x n] J v over the joints that move one
        body and not the other. No joint is looked at by itself.
        """
        n, p = found.normal.T, found.point.T
        if self._native is not None and snapshot.native_state is not None:
            return self._native.rows(snapshot.native_state, found.pairs, n, p)
        line = np.empty((6, len(found.pairs)))
        line[:3] = n
        n, p = np.concatenate((n, n)), np.concatenate((p, p))  # x y z x y z
        arm = np.multiply(p[1:4], n[2:5], out=line[3:])
        arm -= p[2:5] * n[1:4]
        matrix = line.T @ snapshot.joint_twists
        matrix *= chosen_of(self._signs, self._or_all(found.pairs))
        return matrix

    def curvature_bound(self, pairs: Index, step: Array) -> Array:
        """Return how far (k,) the distances may end below their linear prediction [m].

        Over a displacement ``step`` (nv,) the two bodies turn against each other by at most the sum
        of the angles between them. That curves the paths of their points, and where surfaces are
        parallel the nearest points may jump along the shorter one; see ``curvature``.
        """
        return self._curvature.quick(self._or_all(pairs), step)

    def tight_curvature_bound(self, found: PairDistances, step: Array, clearance: Array) -> Array:
        """Return :meth:`curvature_bound`, more closely where it is above ``clearance`` (k,).

        Only surfaces that are parallel and near each other keep the first bound.
        """
        nearest = found.distance, found.normal, found.point
        places = found.snapshot.joint_placements
        return self._curvature.tight(places, found.pairs, nearest, step, clearance)

    def _or_all(self, pairs: Index) -> Index | None:
        """Return the numbers of some pairs, which increase; None if these are all."""
        return None if len(pairs) == len(self.pairs) else pairs

    def _measured(
        self,
        snapshot: Snapshot,
        placed: Array | None,
        tried: Index,
        count: int,
        farthest: float = np.inf,
    ) -> tuple[Index, Array]:
        """Return the ``count`` nearest of the pairs ``tried``, or all, measured exactly.

        Those beyond ``farthest`` need not be exact.
        """
        solids, (where, numbers) = self._solids, self._solids_among(tried)
        if solids is not None and len(where) == count == len(tried):
            return tried, solids.measure(snapshot, numbers)
        placed = self._covers.placed(snapshot) if placed is None else placed
        found = self._covers.capsules(placed, self._or_all(tried))
        distance, rank, limit = found[0], NARROWED * count, farthest
        if self._covers.flat.size:
            distance[np.isin(tried, self._covers.flat)] = -np.inf  # nothing is round a plane
        if where.size > rank:
            limit = min(farthest, float(np.partition(distance, rank)[rank]))
        while solids is not None and where.size:  # those that may be among the nearest
            some, now, far = where, numbers, where[:0]
            if limit < np.inf:
                near = distance.take(where) <= limit
                some, now, far, numbers = where[near], numbers[near], where[~near], numbers[~near]
            if some.size:
                found[:, some] = solids.measure(snapshot, now)
            elif rank < count:
                break
            where, rank = far, min(count, len(tried)) - 1
            if where.size:
                limit = min(farthest, float(np.partition(distance, rank)[rank]))
        if count < len(tried):
            tried, found = _least(tried, found, count)
        return tried, found

    def _solids_among(self, tried: Index) -> tuple[Index, Index]:
        """Return where coal measures among pairs, and their numbers there."""
        if self._or_all(tried) is None:
            return self._every_solid
        numbers = self._solid_number.take(tried)
        where = np.flatnonzero(numbers >= 0)
        return where, numbers.take(where)


def _pair_distances(snapshot: Snapshot, pairs: Index, found: Array) -> PairDistances:
    distance, normal, point = parts(found)
    return PairDistances(pairs, distance, normal.T, point.T, snapshot)


def _above(found: PairDistances, kept: Array | None) -> Array:
    return found.distance if kept is None else found.distance - kept.take(found.pairs)


def _smallest(values: Array, count: int) -> float:
    return float(np.partition(values, count - 1)[count - 1])


def _fewest(found: PairDistances, count: int, kept: Array | None) -> PairDistances:
    """Return the ``count`` of least distance, or least above what they keep, in order."""
    if len(found.pairs) == count:
        return found
    return found.take(np.sort(np.argpartition(_above(found, kept), count)[:count]))


def _least(pairs: Index, found: Array, count: int) -> tuple[Index, Array]:
    """Return the ``count`` nearest of pairs and of what was found of them, in order."""
    best = found[0].argpartition(count)[:count]
    best = best[pairs.take(best).argsort()]
    return pairs.take(best), found.take(best, axis=1)


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
