"""Distances and nearest points of many pairs: of segments by arrays, of other shapes by coal.

Segments follow Ericson, Real-Time Collision Detection (2005), sec. 5.1.9, without branches; other
shapes coal's GJK and EPA, driven by Pinocchio. Components come first, (3, k): NumPy takes a third
of the time along the long side.
"""

from __future__ import annotations

import ctypes
import warnings
from collections.abc import Mapping, Sequence

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from wbc.native import lib
from wbc.robot.collision.fitting import convex
from wbc.robot.collision.shapes import Body, Capsule, HalfSpace, Hull
from wbc.robot.model import Robot, Snapshot
from wbc.validate import Array, read_only

PARALLEL: float = lib.wbc_parallel  # see native/source/pairs.c, as the next
TOUCHING: float = lib.wbc_touching
TOLERANCE = 1e-7  # m, of coal's distances
UNIT = 1e-3  # how far the square of a normal may be off one
Index = NDArray[np.int64]


def nearest_points(A: Array, B: Array, length_a: Array, length_b: Array) -> Array:
    """Return distance, normal and nearest point of segments A and B, (7, k): see :func:`parts`.

    Where axes touch, the normal is the common perpendicular of the two axes on the side of A's
    middle; for parallel axes, the direction between the middles or any perpendicular.

    Parameters
    ----------
    A, B:
        (2 or more, 3, k): start, unit direction (anything for a point).
    length_a, length_b:
        (k,) [m], 0 for points.
    """
    found = np.empty((7, len(length_a)))
    distance, apart, point = parts(found)
    a, b = A[1], B[1]
    between = A[0] - B[0]
    s, t = _shares(a, b, between, length_a, length_b)
    np.multiply(s, a, out=point)
    np.add(between, point, out=apart)
    apart -= t * b
    np.sqrt(_inner(apart, apart), out=distance)
    if distance.size and np.minimum.reduce(distance) < TOUCHING:
        apart /= np.maximum(distance, TOUCHING)
        for k in np.flatnonzero(distance < TOUCHING):
            apart[:, k] = _fallback(length_a[k] * a[:, k], length_b[k] * b[:, k], between[:, k])
    else:
        apart /= distance
    point += A[0]
    return found


def parts(found: Array) -> tuple[Array, Array, Array]:
    """Return views on the rows of (7, k): distances, normals, points.

    Distances (k,) [m] of k pairs of segments or shapes A, B, unit normals (3, k) from B to A, and
    the nearest points (3, k) on A.
    """
    return found[0], found[1:4], found[4:]


def _shares(
    a: Array, b: Array, between: Array, length_a: Array, length_b: Array
) -> tuple[Array, Array]:
    """Return how far along A and along B (k,), (k,) the nearest points are [m]."""
    ab, ar, br = _inner(a, b), _inner(a, between), _inner(b, between)
    sine = 1.0 - ab * ab
    # Parallel segments: any s will do.
    s = _within((ab * br - ar) / np.maximum(sine, PARALLEL, out=sine), length_a)
    t = _within(ab * s + br, length_b)
    return _within(ab * t - ar, length_a), t


def _inner(x: Array, y: Array) -> Array:
    """Return the inner products (k,) of vectors (3, k)."""
    return np.asarray(np.add.reduce(x * y))


def _within(x: Array, length: Array) -> Array:
    np.maximum(x, 0.0, out=x)
    return np.minimum(x, length, out=x)


def _fallback(a: Array, b: Array, between: Array) -> Array:
    """Return a unit vector to push apart two segments whose axes touch."""
    middles = between + 0.5 * (a - b)
    across = np.cross(a, b)
    if float(across @ across) <= PARALLEL * float(a @ a) * float(b @ b):
        axis = a if float(a @ a) >= float(b @ b) else b
        across = _perpendicular(middles, axis)
    across = across / np.linalg.norm(across)
    return across if float(across @ middles) >= 0.0 else -across


def _perpendicular(wanted: Array, axis: Array) -> Array:
    """Return the part of ``wanted`` perpendicular to ``axis``; any perpendicular if it is zero."""
    squared = float(axis @ axis)
    for direction in (wanted, np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])):
        left = direction - (float(direction @ axis) / squared * axis if squared > 0.0 else 0.0)
        if np.linalg.norm(left) > TOUCHING:
            return np.asarray(left)
    return np.array([0.0, 1.0, 0.0])  # not reached: one of z and x is off the axis


class ShapePairs:
    """The pairs of some bodies, to be asked for the distance between their shapes.

    Parameters
    ----------
    pairs:
        (N, 2) indices of bodies.
    """

    def __init__(self, robot: Robot, bodies: Sequence[Body], pairs: Index) -> None:
        self._made_of = robot, bodies, pairs
        self._moved: dict[int, tuple[Array, Array]] = {}  # bodies, and where to
        self._shapes = pin.GeometryModel()
        self._places: list[pin.SE3] = []  # of the shapes in their bodies' frames
        used, numbers = np.unique(pairs, return_inverse=True)
        pairs = numbers.reshape(-1, 2)
        self._numbers = {body: k for k, body in enumerate(used.tolist())}
        bodies = [bodies[k] for k in used.tolist()]
        for k, body in enumerate(bodies):
            geometry, placement = _geometry(body)
            geometry.computeLocalAABB()
            self._places.append(placement)
            # Numbered, because Pinocchio refuses two objects of one name.
            name = f"{k} {body.name}"
            self._shapes.addGeometryObject(
                pin.GeometryObject(name, body.joint, placement, geometry)
            )
        for a, b in pairs.tolist():
            self._shapes.addCollisionPair(pin.CollisionPair(a, b))
        self._rounding = np.array([_rounding(body) for body in bodies])
        self._pairs = pairs
        self._thickness = self._rounding[pairs].sum(axis=1)
        self._first_rounding = self._rounding[pairs[:, 0]]
        self._data = pin.GeometryData(self._shapes)
        for request in self._data.distanceRequests:
            request.gjk_tolerance = request.epa_tolerance = TOLERANCE
            _begin_anew(request)
        self._results = list(self._data.distanceResults)
        self._active = set(range(len(pairs)))  # which Pinocchio's loop measures
        # Anything will do, as long as it is measured: the window is compared with it.
        neutral = robot.postures["neutral"]
        scratch = robot.model.createData()
        pin.updateGeometryPlacements(robot.model, scratch, self._shapes, self._data, neutral)
        pin.computeDistances(self._shapes, self._data)
        self._window = _window(self._results)

    def __reduce__(self) -> tuple[object, ...]:  # coal's results can be neither copied nor pickled
        return type(self)._with_places, (*self._made_of, self._moved)

    @classmethod
    def _with_places(
        cls,
        robot: Robot,
        bodies: Sequence[Body],
        pairs: Index,
        moved: Mapping[int, tuple[Array, Array]],
    ) -> ShapePairs:
        made = cls(robot, bodies, pairs)
        for body, pose in moved.items():
            made.place(body, pose)
        return made

    def place(self, body: int, pose: tuple[Array, Array]) -> None:
        """Move a body that hangs on no joint to a rotation and origin in the world."""
        k = self._numbers.get(body)
        if k is not None:
            self._moved[body] = pose
            self._shapes.geometryObjects[k].placement = pin.SE3(*pose) * self._places[k]

    def measure(self, snapshot: Snapshot, chosen: Index) -> Array:
        """Return distance, normal and nearest point of some pairs, (7, k): see :func:`parts`.

        In Pinocchio's loop, which skips pairs that are switched off: from tick to tick few change,
        and calls from Python would take 0.3 us for each pair.
        """
        robot, wanted = snapshot.robot, chosen.tolist()
        changed = self._active.symmetric_difference(wanted)
        if changed:
            switches, active = self._data.activeCollisionPairs, self._active
            for k in changed:
                switches[k] = k not in active
            self._active = set(wanted)
        data = robot.workspace.placed(snapshot, snapshot.q)
        pin.updateGeometryPlacements(robot.model, data, self._shapes, self._data)
        pin.computeDistances(self._shapes, self._data)
        if self._window is None:
            rows = _read([self._results[k] for k in wanted])
        else:
            rows = self._window.take(chosen, axis=0)
        found = np.ascontiguousarray(rows.T)
        distance, normal, point = parts(found)
        np.negative(normal, out=normal)
        self._repair(normal, chosen)
        distance -= self._thickness.take(chosen)
        point -= self._first_rounding.take(chosen) * normal
        return found

    def _repair(self, normal: Array, chosen: Index) -> None:
        """Give pairs whose normal is no unit vector the direction between the bodies' middles."""
        off = np.abs(np.add.reduce(normal * normal) - 1.0)
        if np.maximum.reduce(off, initial=0.0) < UNIT:  # not so if one is not a number
            return
        for k in np.flatnonzero(~(off < UNIT)):
            a, b = self._pairs[chosen[k]].tolist()
            centres = [self._data.oMg[i].act(self._middle(i)) for i in (a, b)]
            apart = centres[0] - centres[1]
            size = float(np.linalg.norm(apart))
            normal[:, k] = apart / size if size > TOLERANCE else (0.0, 0.0, 1.0)

    def _middle(self, body: int) -> Array:
        return np.array(self._shapes.geometryObjects[body].geometry.aabb_center)


def _geometry(body: Body) -> tuple[coal.ShapeBase, pin.SE3]:
    """Return coal's shape and its place in the joint's frame."""
    shape = body.shape
    if isinstance(shape, HalfSpace):
        return coal.Halfspace(shape.normal, shape.offset), pin.SE3.Identity()
    if isinstance(shape, Hull):
        return convex(shape.vertices), pin.SE3.Identity()
    axis = shape.ends[1] - shape.ends[0]
    length, middle = float(np.linalg.norm(axis)), shape.ends.mean(axis=0)
    if length < TOLERANCE:
        return coal.Sphere(shape.radius), pin.SE3(np.eye(3), middle)
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis / length)
    return coal.Capsule(shape.radius, length), pin.SE3(turn.toRotationMatrix(), middle)


def _rounding(body: Body) -> float:
    """Return the radius that coal does not know of."""
    return 0.0 if isinstance(body.shape, Capsule) else body.shape.radius


def _read(results: Sequence[coal.DistanceResult]) -> Array:
    """Return distance, normal and nearest point on the first (n, 7) of n results, one by one."""
    found = [(one.min_distance, *one.normal, *one.getNearestPoint1()) for one in results]
    return np.array(found).reshape(-1, 7)


def _window(results: Sequence[coal.DistanceResult]) -> Array | None:
    """Return a view (n, 7) on what :func:`_read` reads of results that were measured, or None.

    coal keeps the distance right before the normal and the points right behind it, but gives only
    the normal as a view. Through this window 25 pairs take 2 us, one by one 20.
    """
    normals = _side_by_side([result.normal for result in results])
    if normals is None or (len(results) > 1 and normals.strides[0] < 7 * normals.itemsize):
        return None
    size = (len(results) - 1) * normals.strides[0] + 7 * normals.itemsize
    memory = (ctypes.c_char * size).from_address(normals.ctypes.data - normals.itemsize)
    rows = np.ndarray((len(results), 7), buffer=memoryview(memory), strides=(normals.strides[0], 8))
    return read_only(rows) if np.array_equal(rows, _read(results)) else None


def _side_by_side(fields: Sequence[Array]) -> Array | None:
    """Return one view (n, ...) on n arrays that lie at a constant distance in memory, or None.

    The view does not keep these arrays alive.
    """
    first = fields[0]
    steps = np.unique(np.diff([field.ctypes.data for field in fields]))
    if len(steps) > 1 or any(field.flags.owndata for field in fields):
        return None
    step = int(steps[0]) if len(steps) else first.nbytes
    shape, strides = (len(fields), *first.shape), (step, *first.strides)
    return np.lib.stride_tricks.as_strided(first, shape=shape, strides=strides, writeable=False)


def _begin_anew(request: coal.DistanceRequest) -> None:
    """Let every search begin between the shapes' middles: distances depend on the posture alone.

    Pinocchio lets coal begin where the last search for a pair ended, by a switch that coal wants to
    rename: hence the warning. Between parallel faces the nearest points then were those of the
    past. The middles are as good to begin with; coal's own choice takes half as long again.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        request.enable_cached_gjk_guess = False
    request.gjk_initial_guess = coal.GJKInitialGuess.BoundingVolumeGuess
