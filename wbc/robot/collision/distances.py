"""Distances and nearest points of pairs of bodies by coal, which knows how deep they overlap.

Components come first, (7, k), as the core writes them.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from wbc.robot.collision.fitting import convex
from wbc.robot.collision.shapes import Body, Capsule, HalfSpace, Hull
from wbc.robot.model import Robot, Snapshot
from wbc.validate import Array

TOLERANCE = 1e-7  # m, of coal's distances
UNIT = 1e-3  # how far the square of a normal may be off one
Index = NDArray[np.int64]
Pose = tuple[Array, Array]  # rotation (3, 3) and origin (3,) in the world


def parts(found: Array) -> tuple[Array, Array, Array]:
    """Return views on the rows of (7, k): distances, normals, points.

    Distances (k,) [m] of k pairs of shapes A, B, unit normals (3, k) from B to A, and the nearest
    points (3, k) on A.
    """
    return found[0], found[1:4], found[4:]


class ShapePairs:
    """The pairs of some bodies, to be asked for the distance between their shapes.

    Parameters
    ----------
    pairs:
        (N, 2) indices of bodies.
    moved:
        Where bodies are that hang on no joint, if they were moved.
    """

    def __init__(
        self, robot: Robot, bodies: Sequence[Body], pairs: Index, moved: Mapping[int, Pose]
    ) -> None:
        self._pairs, self._shapes = pairs, pin.GeometryModel()
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
        rounding = np.array([_rounding(body) for body in bodies])
        self._thickness = rounding[pairs].sum(axis=1)
        self._first_rounding = rounding[pairs[:, 0]]
        self._joints, self._data = robot.model.createData(), pin.GeometryData(self._shapes)
        for request in self._data.distanceRequests:
            request.gjk_tolerance = request.epa_tolerance = TOLERANCE
            _begin_anew(request)
        for number, pose in moved.items():
            self.place(number, pose)

    def place(self, body: int, pose: Pose) -> None:
        """Move a body that hangs on no joint."""
        self._shapes.geometryObjects[body].placement = pin.SE3(*pose) * self._places[body]

    def measure(self, snapshot: Snapshot, chosen: Index) -> Array:
        """Return distance, normal and nearest point of some pairs, (7, k): see :func:`parts`."""
        robot, shapes, results = snapshot.robot, self._shapes, []
        pin.updateGeometryPlacements(robot.model, self._joints, shapes, self._data, snapshot.q)
        for k in chosen.tolist():
            one = pin.computeDistance(shapes, self._data, k)
            results.append((one.min_distance, *-one.normal, *one.getNearestPoint1()))
        found = np.ascontiguousarray(np.array(results).T)
        distance, normal, point = parts(found)
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
