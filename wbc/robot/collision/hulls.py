"""Distances of pairs of any shapes: coal's GJK and EPA, driven by Pinocchio."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from wbc.robot.collision.fitting import convex
from wbc.robot.collision.shapes import Body, Capsule, HalfSpace, Hull
from wbc.robot.model import Robot, Snapshot
from wbc.robot.workspace import side_by_side
from wbc.validate import Array

TOLERANCE = 1e-7  # m, of the distance
UNIT = 1e-3  # how far the square of a normal may be off one
Index = NDArray[np.int64]


class SolidPairs:
    """The pairs of some bodies, to be asked for the distance between their shapes.

    Parameters
    ----------
    pairs:
        (N, 2) indices of bodies.
    """

    def __init__(self, robot: Robot, bodies: Sequence[Body], pairs: Index) -> None:
        self._shapes = pin.GeometryModel()
        self._places: list[pin.SE3] = []  # of the shapes in their bodies' frames
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

    def place(self, body: int, pose: tuple[Array, Array]) -> None:
        """Move a body that hangs on no joint to a rotation and origin in the world."""
        self._shapes.geometryObjects[body].placement = pin.SE3(*pose) * self._places[body]

    def distances(self, snapshot: Snapshot, chosen: Index) -> Array:
        """Return the distances (k,) [m] of the chosen pairs, negative inside each other."""
        robot = snapshot.robot
        data = robot.workspace.kinematics(snapshot, snapshot.q, snapshot.v)
        pin.updateGeometryPlacements(robot.model, data, self._shapes, self._data)
        wanted = chosen.tolist()
        self._measure(wanted)
        results = self._results
        distance = np.array([results[k].min_distance for k in wanted])
        distance -= self._thickness.take(chosen)
        return distance

    def _measure(self, wanted: list[int]) -> None:
        """Measure some pairs in Pinocchio's loop: it skips those that are switched off.

        From tick to tick few pairs change, and calls from Python would take 0.3 us for each.
        """
        changed = self._active.symmetric_difference(wanted)
        if changed:
            switches, active = self._data.activeCollisionPairs, self._active
            for k in changed:
                switches[k] = k not in active
            self._active = set(wanted)
        pin.computeDistances(self._shapes, self._data)

    def witnesses(self, chosen: Index) -> tuple[Array, Array]:
        """Return normals (3, k) and points on the first bodies (3, k) of pairs just measured."""
        if self._window is None:
            both = _read([self._results[k] for k in chosen.tolist()])
        else:
            both = self._window.take(chosen, axis=0)
        both = np.ascontiguousarray(both.T)
        normal, point = np.negative(both[:, 0]), both[:, 1]
        self._repair(normal, chosen)
        point -= self._first_rounding.take(chosen) * normal
        return normal, point

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
    """Return normals and nearest points (n, 2, 3) of n results, one by one."""
    found = [(result.normal, result.getNearestPoint1()) for result in results]
    return np.array(found).reshape(-1, 2, 3)


def _window(results: Sequence[coal.DistanceResult]) -> Array | None:
    """Return a view (n, 2, 3) on what :func:`_read` reads of results that were measured, or None.

    coal keeps the points right behind the normal, but gives only the normal as a view. Through
    this window 25 pairs take 2 us, one by one 18.
    """
    normals = side_by_side([result.normal for result in results])
    if normals is None or (len(results) > 1 and normals.strides[0] < 2 * normals[0].nbytes):
        return None
    both = np.lib.stride_tricks.as_strided(
        normals,
        shape=(len(results), 2, 3),
        strides=(normals.strides[0], normals[0].nbytes, normals.strides[1]),
        writeable=False,
    )
    return both if np.array_equal(both, _read(results)) else None


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
