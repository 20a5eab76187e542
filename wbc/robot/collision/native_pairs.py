"""Pairs of convex bodies in the native core: the nearest, their distances and Jacobians.

One call compares the bounding balls of all bodies and measures the pairs that may be among the
nearest: capsules as segments, others by corners.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.native import doubles, ffi, integers, lib, pointer
from wbc.robot.collision.fitting import quick_capsule
from wbc.robot.collision.shapes import Body, Capsule, HalfSpace, Hull, Shape
from wbc.robot.kernel import NativeState, NativeTree
from wbc.validate import Array, Index


class Closing(NamedTuple):
    """Braking of a closing pair: the inverse of the speed that a margin allows."""

    dt: float  # time for which a speed is held before braking begins [s]
    deceleration: float  # of the distance [m/s^2]
    gain: float  # largest fraction of the clearance to use up in one tick
    # Time that the slowest joint takes to stop, max |v| / a [s]; 0 if joints brake without limit.
    # A distance of Jacobian J closes at |J| |v| at most and is braked by |J| a: it takes no
    # longer than that joint.
    slowest: float = 0.0


class SoonestPairs(NamedTuple):
    """Pairs that must brake first: their numbers, increasing, and distances."""

    pairs: Index  # (k,)
    nearest: Array  # (7, k), as of :meth:`NativePairs.nearest`
    left: Array  # (k,) clearance after braking [m]
    complete: bool  # whether all others have a positive one


class NativePairs:
    """Pairs of bodies as the core reads them, at the present poses of those that are moved.

    ``pairs``: (N, 2) indices of bodies; a half-space is the second of its pair.
    ``parents``: of each joint; parents precede their children.

    ``counts``: of bodies and of pairs.
    ``arrays``: by the names of ``wbc_pairs`` in source/core.h.
    """

    def __init__(self, bodies: Sequence[Body], pairs: Index, parents: Sequence[int]) -> None:
        self._arguments = bodies, pairs, parents
        joints = np.array([body.joint for body in bodies], dtype=np.int64)
        both = joints[pairs].tolist()
        common = np.array([_common_joint(parents, a, b) for a, b in both], dtype=np.int64)
        local, sizes = _bounding_shapes(bodies)
        self._own = local.copy()  # before bodies are moved
        known: dict[type[Shape], int] = {Capsule: lib.CAPSULES, HalfSpace: lib.ABOVE}
        kinds = np.array([known.get(type(body.shape), lib.HULLS) for body in bodies], np.int64)
        cores = [body.shape.core for body in bodies]
        self._first = np.cumsum([0, *map(len, cores)], dtype=np.int64)
        self._corner = np.ascontiguousarray(np.concatenate(cores).T)
        rounding = np.array([body.shape.radius for body in bodies])
        self.arrays: dict[str, NDArray[Any]] = {
            "joint": joints,
            "local": local,
            "size": sizes,
            "pair": pairs,
            "kind": kinds[pairs].max(axis=1, initial=lib.CAPSULES),
            "common": common,
            "first": self._first,
            "corner": self._corner,
            "rounding": rounding,
            "shorter": np.array([body.length for body in bodies])[pairs].min(axis=1),
        }
        self.counts = len(joints), len(pairs)
        self._expected_near = 16.0  # expected pairs per state, for the first allocation
        self._every = np.arange(len(joints))
        self._places = {name: pointer(array) for name, array in self.arrays.items()}

    def __reduce__(self) -> tuple[object, ...]:  # arrays of its own
        return type(self)._with_places, (*self._arguments, self.arrays["local"], self._corner)

    @classmethod
    def _with_places(cls, *parts: Any) -> NativePairs:
        *arguments, local, corner = parts
        made = cls(*arguments)
        made.arrays["local"][:], made._corner[:] = local, corner
        return made

    def place(self, body: int, rotation: Array, origin: Array, core: Array) -> None:
        """Set the world pose of a body of joint 0, and its corners (k, 3)."""
        local = self.arrays["local"][body]
        local[:] = rotation @ self._own[body]
        local[:, ::2] += origin[:, None]
        self._corner[:, self._first[body] : self._first[body + 1]] = core.T

    def nearest(
        self, state: NativeState, count: int, kept: Array | None = None
    ) -> tuple[Index, Array] | None:
        """Return the ``count`` pairs of least distance, or of least distance less ``kept`` (N,).

        Their numbers, increasing, and distance, normal, point (7, k). Hulls that overlap have the
        distance -infinity: the core does not compute penetration depths. None if ``count`` pairs
        overlap.
        """
        bodies, pairs = self.counts
        scratch, found = np.empty(10 * (bodies + pairs)), np.empty((7, count))
        chosen = np.empty(count, dtype=np.int64)
        struct = self.struct(state.tree)
        at, work, nearest = map(doubles, (state.array, scratch, found))
        less, numbers = ffi.NULL if kept is None else doubles(kept), integers(chosen)
        said = lib.wbc_nearest(struct, at, count, less, work, numbers, nearest)
        return None if said else (chosen, found)

    def soonest(
        self, state: NativeState, count: int, kept: Array, twists: Array, closing: Closing
    ) -> SoonestPairs | None:
        """Return the ``count`` pairs of least clearance after braking; None: as nearest.

        ``kept``: (N,) least distances [m]; ``twists``: (6, bodies) velocities at the world's origin
        [m/s] and spins [rad/s].
        """
        bodies, pairs = self.counts
        scratch, found = np.empty(10 * (bodies + pairs)), np.empty((8, count))
        chosen, twist = np.empty(count, dtype=np.int64), np.ascontiguousarray(twists.T)
        own = ffi.new(
            "wbc_closing *",
            {
                "twist": doubles(twist),
                "carrier": integers(self._every),
                "dt": closing.dt,
                "slowest": closing.slowest,
                "least": closing.dt / closing.gain,
                "half": 0.5 / closing.deceleration,
            },
        )
        given = self.struct(state.tree), doubles(state.array), count, doubles(kept), own
        out = doubles(scratch), integers(chosen), doubles(found), doubles(found[7])
        said = lib.wbc_most_urgent_pairs(*given, *out)
        return None if said < 0 else SoonestPairs(chosen, found[:7], found[7], said == 0)

    def measure(self, state: NativeState, pairs: Index) -> Array:
        """Return distance, normal and point (7, k) of some pairs: see :meth:`nearest`."""
        scratch, found = np.empty(9 * self.counts[0]), np.empty((7, len(pairs)))
        struct = self.struct(state.tree)
        at, work, nearest = map(doubles, (state.array, scratch, found))
        numbers = integers(np.ascontiguousarray(pairs))
        lib.wbc_measure(struct, at, len(pairs), numbers, work, nearest)
        return found

    def within(
        self, states: Array, tree: NativeTree, limit: float, kept: Array
    ) -> tuple[Index, Array]:
        """Return state and pair numbers (k, 2) of clearances below ``limit`` [m].

        With distance, normal and point (k, 7), as of :meth:`nearest`.

        ``states``: (n, size), one state a row, finite.
        ``kept``: (N,) [m].
        """
        bodies, pairs = self.counts
        scratch, struct = np.empty(9 * bodies + pairs), self.struct(tree)
        room = math.ceil(self._expected_near * len(states))
        given = (len(states), states.shape[1], limit, doubles(kept))
        while True:
            chosen, found = np.empty((room, 2), dtype=np.int64), np.empty((room, 7))
            at, work, nearest = map(doubles, (states, scratch, found))
            count = lib.wbc_pairs_within(struct, at, *given, work, room, integers(chosen), nearest)
            if count <= room:
                return chosen[:count], found[:count]
            room, self._expected_near = int(count), 1.1 * count / len(states)

    def rows(self, state: NativeState, pairs: Index, normal: Array, point: Array) -> Array:
        """Return the derivatives (k, nv) of distances by v.

        ``normal``, ``point``: (3, k): unit vectors from the second body to the first, and points on
        the first.
        """
        tree, out = state.tree, np.empty((len(pairs), state.tree.nv))
        struct = self.struct(tree)
        chosen = integers(np.ascontiguousarray(pairs))
        n, p = (doubles(np.ascontiguousarray(array)) for array in (normal, point))
        where = struct, tree.struct, doubles(state.array)
        lib.wbc_pair_rows(*where, len(pairs), chosen, n, p, doubles(out))
        return out

    def rows_within(self, states: Array, tree: NativeTree, pairs: Index, found: Array) -> Array:
        """Return the derivatives (k, nv) by v of distances as :meth:`within` gives them."""
        out, at = np.empty((len(pairs), tree.nv)), (doubles(states), states.shape[1])
        where = self.struct(tree), tree.struct, *at
        chosen, nearest = pointer(np.ascontiguousarray(pairs)), pointer(np.ascontiguousarray(found))
        lib.wbc_rows_within(*where, len(pairs), chosen, nearest, pointer(out))
        return out

    def curvature_bounds(self, tree: NativeTree, pairs: Index, step: Array) -> Array:
        """Return how far (k,) distances may end below their linear prediction [m].

        Over a displacement ``step`` (nv,): see ``bend`` of native/source/margin.c.
        """
        turns, out = np.empty(tree.joints), np.empty(len(pairs))
        chosen, moved = np.ascontiguousarray(pairs), np.ascontiguousarray(step)
        given = self.struct(tree), tree.struct, doubles(moved), len(pairs), integers(chosen)
        lib.wbc_curvature_bounds(*given, doubles(turns), doubles(out))
        return out

    def struct(self, tree: NativeTree) -> Any:
        """Return a pointer to a ``wbc_pairs``, valid as long as this object lives."""
        bodies, pairs = self.counts
        sizes = {"nv": tree.nv, "joints": tree.joints, "bodies": bodies, "pairs": pairs}
        return ffi.new("wbc_pairs *", {**sizes, **self._places})


def _bounding_shapes(bodies: Sequence[Body]) -> tuple[Array, Array]:
    """Return a bounding ball and capsule of each body; a capsule's is itself.

    A half-space is represented by a point of its surface.

    Returns
    -------
    local : Array
        (bodies, 3, 3) start, unit direction and middle of each, in columns, in its joint's axes.
    sizes : Array
        (bodies, 3) length and radius of the capsule, radius of the ball [m].
    """
    found = [_bounding_capsule(body.shape) for body in bodies]
    local = np.stack([_columns(*both) for both in zip(bodies, found, strict=True)])
    lengths, radii = [_length(cover) for cover in found], [cover.radius for cover in found]
    return local, np.column_stack((lengths, radii, [body.bounding_ball[1] for body in bodies]))


def _bounding_capsule(shape: Shape) -> Capsule:
    """Return a bounding capsule of a shape; for a half-space, a point of its surface."""
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


def _common_joint(parents: Sequence[int], a: int, b: int) -> int:
    """Return the last joint that moves both."""
    while a != b:
        a, b = (parents[a], b) if a > b else (a, parents[b])
    return a
