"""Distances of pairs that are not two capsules: coal's GJK and EPA, driven by Pinocchio."""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from wbc.robot.collision.fitting import convex
from wbc.robot.collision.shapes import Body, Capsule, HalfSpace, Hull
from wbc.robot.snapshot import Snapshot
from wbc.validate import Array

TOLERANCE = 1e-7  # m, of the distance
Index = NDArray[np.int64]


class SolidPairs:
    """The pairs of some bodies, to be asked for the distance between their shapes.

    Parameters
    ----------
    pairs:
        (N, 2) indices of bodies.
    """

    def __init__(self, bodies: Sequence[Body], pairs: Index) -> None:
        self._shapes = pin.GeometryModel()
        self._places: list[pin.SE3] = []  # of the shapes in their bodies' frames
        for k, body in enumerate(bodies):
            geometry, placement = _geometry(body)
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
        self._data = pin.GeometryData(self._shapes)
        for request in self._data.distanceRequests:
            request.gjk_tolerance = request.epa_tolerance = TOLERANCE
        self._results = list(self._data.distanceResults)

    def place(self, body: int, pose: tuple[Array, Array]) -> None:
        """Move a body that hangs on no joint to a rotation and origin in the world."""
        self._shapes.geometryObjects[body].placement = pin.SE3(*pose) * self._places[body]

    def distances(self, snapshot: Snapshot, chosen: Index) -> Array:
        """Return the distances (k,) [m] of the chosen pairs, negative inside each other."""
        robot = snapshot.robot
        data = robot.workspace.kinematics(snapshot, snapshot.q, snapshot.v)
        shapes, store, results = self._shapes, self._data, self._results
        pin.updateGeometryPlacements(robot.model, data, shapes, store)
        wanted = chosen.tolist()
        for k in wanted:
            pin.computeDistance(shapes, store, k)
        distance = np.array([results[k].min_distance for k in wanted])
        distance -= self._thickness.take(chosen)
        return distance

    def witnesses(self, chosen: Index) -> tuple[Array, Array]:
        """Return normals (k, 3) and points on the first bodies (k, 3) of pairs just measured."""
        found = [self._results[k] for k in chosen.tolist()]
        normal = -np.array([result.normal for result in found]).reshape(-1, 3)
        point = np.array([result.getNearestPoint1() for result in found]).reshape(-1, 3)
        self._repair(normal, chosen)
        point -= self._rounding.take(self._pairs[chosen, 0])[:, None] * normal
        return normal, point

    def _repair(self, normal: Array, chosen: Index) -> None:
        """Give pairs whose normal is no unit vector the direction between the bodies' origins."""
        sound = np.abs(np.einsum("ki,ki->k", normal, normal) - 1.0) < 1e-3
        if sound.all():
            return
        for k in np.flatnonzero(~sound):
            a, b = self._pairs[chosen[k]].tolist()
            centres = [self._data.oMg[i].act(self._middle(i)) for i in (a, b)]
            apart = centres[0] - centres[1]
            size = float(np.linalg.norm(apart))
            normal[k] = apart / size if size > TOLERANCE else (0.0, 0.0, 1.0)

    def _middle(self, body: int) -> Array:
        box = self._shapes.geometryObjects[body].geometry
        box.computeLocalAABB()
        return np.array(box.aabb_center)


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
