"""Pairs of bodies: the nearest, their distances, and how these change with the velocity."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from wbc.errors import InvalidInputError, shown
from wbc.robot.collision.distances import RawPairs, ShapePairs, split_rows
from wbc.robot.collision.native_pairs import Closing, NativePairs
from wbc.robot.collision.shapes import Body, HalfSpace
from wbc.robot.model import Robot, Snapshot
from wbc.validate import Array, Bools, Index, finite_array, read_only

# If many bodies touch, so many times as many pairs are requested from the core before all: it does
# not know penetration depths, so other pairs may be deeper.
TOUCHING_FACTOR = 4
_REST = read_only(np.zeros(3))


class PairDistances(NamedTuple):
    """Distances, normals and nearest points of k pairs of bodies."""

    pairs: Index  # (k,) which of the model's pairs, increasing
    distance: Array  # (k,) between the surfaces [m], negative where they overlap
    normal: Array  # (k, 3) unit vectors from the second body to the first, world axes
    # (k, 3) on the surface of the first body; that of the second is point - distance normal.
    point: Array
    snapshot: Snapshot

    def take(self, chosen: Index) -> PairDistances:
        """Return some of them, by index."""
        pairs, normal, point = self.pairs[chosen], self.normal[chosen], self.point[chosen]
        return PairDistances(pairs, self.distance[chosen], normal, point, self.snapshot)


class CollisionModel:
    """Bodies on a robot, and some at rest or moved from outside, with the pairs to be kept apart.

    Parameters
    ----------
    bodies:
        Those of joint 0 are not attached to the robot; see :meth:`place`.
    pairs:
        Pairs of indices of bodies, not both on one joint.

    Attributes
    ----------
    labels:
        One for each pair, such as ``"left_hand vs pelvis"``.
    native:
        The pairs as the native core reads them.
    """

    def __init__(
        self, robot: Robot, bodies: Sequence[Body], pairs: Sequence[tuple[int, int]]
    ) -> None:
        self.robot = robot
        self.bodies = tuple(bodies)
        self.pairs: Index = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        names = [body.name for body in self.bodies]
        self.labels = tuple(f"{names[a]} vs {names[b]}" for a, b in self.pairs)
        self._joints = joints = np.array([body.joint for body in self.bodies], dtype=np.int64)
        self._every: Index = np.arange(len(self.pairs))
        self._every.flags.writeable = False
        first, second = self.pairs.T
        same = np.flatnonzero(joints[first] == joints[second])
        if same.size:
            k = int(same[0])
            raise InvalidInputError(f"pair {self.labels[k]!r}: both are on one joint")
        self._moves = _moving_velocities(robot)[joints]  # (bodies, nv)
        self._own_twists = np.zeros((6, len(joints)))  # of bodies not attached to the robot
        if any(isinstance(self.bodies[k].shape, HalfSpace) for k in first.tolist()):
            raise InvalidInputError("pairs: a half-space must be the second of a pair")
        self._overlapping = ShapePairs(self.bodies, self.pairs)
        self._many_touch = 0
        parents = robot.native.tree.arrays["parent"].tolist()
        self.native = NativePairs(self.bodies, self.pairs, parents)

    def __repr__(self) -> str:
        counts = f"bodies={len(self.bodies)}, pairs={len(self.pairs)}"
        return f"CollisionModel({self.robot.name}, {counts})"

    @cached_property
    def raw(self) -> RawPairs:
        """The pairs with the raw shapes of the robot's files, read on first use."""
        return RawPairs(self.robot, self.bodies, self.pairs)

    def place(
        self,
        body: int,
        rotation: Array,
        origin: Array,
        velocity: Array = _REST,
        spin: Array = _REST,
    ) -> None:
        """Move a body of joint 0: its shape's frame is put at ``rotation``, ``origin`` (world).

        ``velocity`` is that of the frame's origin, ``spin`` its angular velocity, world axes.
        """
        if self._joints[body] != 0:
            raise InvalidInputError(f"body {self.bodies[body].name!r} is moved by the robot")
        R = finite_array("rotation", rotation, (3, 3))
        p = finite_array("origin", origin, (3,))
        core = self.bodies[body].shape.core @ R.T + p
        self._own_twists[:3, body] = velocity - np.cross(spin, p)
        self._own_twists[3:, body] = spin
        self.native.place(body, R, p, core)
        self._overlapping.place(body, R, p)

    def measure(self, snapshot: Snapshot, pairs: Index) -> PairDistances:
        """Return the distances of some pairs, given by their numbers, increasing.

        Raises
        ------
        InvalidInputError
            Numbers of no pairs.
        """
        total = len(self.pairs)  # beyond them the core would read what is none
        numbers = isinstance(pairs, np.ndarray) and pairs.ndim == 1 and pairs.dtype.kind in "iu"
        if not numbers or (pairs.size and not 0 <= pairs.min() <= pairs.max() < total):
            raise InvalidInputError(
                f"pairs: expected numbers (k,) from 0 to {total - 1}, got {shown(pairs)}"
            )
        pairs = pairs.astype(np.int64, copy=False)  # as the core reads them
        found = self.native.measure(snapshot.native_state, pairs)
        self._fill_in(snapshot, pairs, found)
        return _pair_distances(snapshot, pairs, found)

    def nearest(
        self, snapshot: Snapshot, count: int | None = None, kept: Array | None = None
    ) -> PairDistances:
        """Return the ``count`` nearest pairs, or all, in the order of :attr:`pairs`.

        ``kept`` (N,) [m]: least distances of the pairs, subtracted before comparing.
        """
        if count is not None and count < 1:
            raise InvalidInputError(f"nearest, count: at least 1, got {count}")
        total = len(self.pairs)
        count = total if count is None else min(count, total)
        # Bodies touch for many ticks: start with the count that was needed last.
        for most in (count, min(TOUCHING_FACTOR * count, total))[self._many_touch :]:
            nearest = self.native.nearest(snapshot.native_state, most, kept)
            if nearest is None:
                continue
            touching = np.count_nonzero(nearest[1][0] == -np.inf)
            if most < total and TOUCHING_FACTOR * touching > most:
                continue  # coal would take as long for these as for all
            known = self._fill_in(snapshot, *nearest)
            found = _pair_distances(snapshot, *nearest)
            left = _clearances(found, kept)
            # Pairs that the core left out are no nearer than those that it measured.
            if (
                known.all()
                or left[known].max(initial=-np.inf) >= np.partition(left, count - 1)[count - 1]
            ):
                self._many_touch = int(TOUCHING_FACTOR * touching > count)
                return _closest(found, count, kept)
        return _closest(self.measure(snapshot, self._every), count, kept)

    def soonest(
        self, snapshot: Snapshot, count: int, kept: Array, closing: Closing
    ) -> tuple[PairDistances, Array]:
        """Return the pairs that must brake first, in order, and their remaining clearance (k,) [m].

        If velocities cannot change at once, these are not the nearest pairs, but those with the
        least clearance after braking: distance minus ``kept`` (N,) minus braking distance. Returned
        are the ``count`` pairs with the least, and all with a negative one.
        """
        total = len(self.pairs)
        requested = count = min(count, total)
        twists = self.twists(snapshot)
        while True:
            found = self.native.soonest(snapshot.native_state, requested, kept, twists, closing)
            if requested == total or (found is not None and found.complete):
                break
            requested = min(2 * requested, total)
        if found is None:  # all pairs are inside each other
            every = self.measure(snapshot, self._every)
            return every, every.distance - kept
        self._fill_in(snapshot, found.pairs, found.nearest)
        distances, left = _pair_distances(snapshot, found.pairs, found.nearest), found.left
        unknown = left == -np.inf
        left[unknown] = (distances.distance - kept.take(found.pairs))[unknown]
        if requested == count:
            return distances, left
        late = np.flatnonzero(left < 0.0)
        return distances.take(late), left.take(late)

    def _fill_in(self, snapshot: Snapshot, pairs: Index, found: Array) -> Bools:
        """Measure the pairs that the core could not, by coal; return the others' mask (k,)."""
        known = found[0] > -np.inf
        if not known.all():
            found[:, ~known] = self._overlapping.measure(snapshot, pairs[~known])
        return known

    def rows(self, snapshot: Snapshot, found: PairDistances) -> Array:
        """Return the derivative (k, nv) of the distances by the velocity.

        The normal n through both nearest points is a line of force: with the twists J of the
        joints at the world's origin, d(distance)/dt = [n, p x n] J v over the joints that move one
        body and not the other.
        """
        n, p = found.normal.T, found.point.T
        return self.native.rows(snapshot.native_state, found.pairs, n, p)

    def twists(self, snapshot: Snapshot) -> Array:
        """Return the bodies' twists (6, bodies): velocity at the world's origin [m/s], spin."""
        moving: Array = snapshot.joint_twists @ (self._moves * snapshot.v).T
        moving += self._own_twists
        return moving

    def rates(self, found: PairDistances) -> Array:
        """Return the rates (k,) [m/s] of distances while the robot stands still."""
        first, second = self.pairs[found.pairs].T
        turn = self._own_twists.take(second, axis=1) - self._own_twists.take(first, axis=1)
        moving = turn[:3].T + np.cross(turn[3:].T, found.point)
        rates: Array = -np.einsum("ki,ki->k", moving, found.normal)
        return rates

    def curvature_bound(self, pairs: Index, step: Array) -> Array:
        """Return how far (k,) the distances may end below their linear prediction [m].

        Over a displacement ``step`` (nv,) the bodies rotate relative to each other by at most the
        sum of the angles of the joints between them. That curves the paths of their points, and
        between parallel surfaces the nearest points may jump along the shorter one.
        """
        return self.native.curvature_bounds(self.robot.native.tree, pairs, step)


def _pair_distances(snapshot: Snapshot, pairs: Index, found: Array) -> PairDistances:
    distance, normal, point = split_rows(found)
    return PairDistances(pairs, distance, normal.T, point.T, snapshot)


def _clearances(found: PairDistances, kept: Array | None) -> Array:
    return found.distance if kept is None else found.distance - kept.take(found.pairs)


def _closest(found: PairDistances, count: int, kept: Array | None) -> PairDistances:
    """Return the ``count`` of least distance, or of least distance above ``kept``, in order."""
    if len(found.pairs) == count:
        return found
    return found.take(np.sort(np.argpartition(_clearances(found, kept), count)[:count]))


def _moving_velocities(robot: Robot) -> Array:
    """Return (njoints, nv): 1 where a velocity moves the body of a joint, else 0."""
    model = robot.model
    moves = np.zeros((model.njoints, model.nv))
    for joint in range(1, model.njoints):
        for above in list(model.supports[joint])[1:]:
            start = model.idx_vs[above]
            moves[joint, start : start + model.nvs[above]] = 1.0
    return read_only(moves)
