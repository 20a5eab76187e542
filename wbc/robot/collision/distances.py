"""Distances and nearest points of pairs of bodies by coal, penetration depths included.

Arrays are (7, k), components first, as the core writes them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import coal
import numpy as np
import pinocchio as pin

from wbc.robot.collision.bodies import named_shapes
from wbc.robot.collision.fitting import convex, fit_close_hull
from wbc.robot.collision.shapes import Body, Capsule
from wbc.robot.model import Robot, Snapshot
from wbc.validate import Array, Index

TOLERANCE = 1e-7  # m, of coal's distances
UNIT = 1e-3  # tolerance of a normal's squared length
CONTACT = 1e-6  # m
HULL_TOLERANCE, ROUNDING = 1e-3, 1e-5  # m: of hulls around meshes, and of Coal's distances


def split_rows(found: Array) -> tuple[Array, Array, Array]:
    """Return views on the rows of (7, k): distances, normals, points.

    Distances (k,) [m] of k pairs of shapes A, B, unit normals (3, k) from B to A, and the nearest
    points (3, k) on A.
    """
    return found[0], found[1:4], found[4:]


class ShapePairs:
    """Pairs of bodies, and the distances between their shapes.

    ``pairs``: (N, 2) indices of bodies, none of which is a half-space.
    """

    def __init__(self, bodies: Sequence[Body], pairs: Index) -> None:
        self._bodies, self._pairs = bodies, pairs
        self._moved: dict[int, tuple[Array, Array]] = {}
        self._shapes: dict[int, tuple[coal.ShapeBase, pin.SE3]] = {}  # by body, made on demand

    def __getstate__(self) -> dict[str, object]:  # coal's shapes can be neither copied nor pickled
        return {**vars(self), "_moved": self._moved.copy(), "_shapes": {}}

    def place(self, body: int, rotation: Array, origin: Array) -> None:
        """Move a body that is not attached to a joint."""
        self._moved[body] = rotation, origin

    def measure(self, snapshot: Snapshot, chosen: Index) -> Array:
        """Return distance, normal and point (7, k) of some pairs; see :func:`split_rows`."""
        found, request = np.empty((7, len(chosen))), coal.DistanceRequest()
        request.gjk_tolerance = request.epa_tolerance = TOLERANCE
        # Coal's own choice takes half as long again.
        request.gjk_initial_guess = coal.GJKInitialGuess.BoundingVolumeGuess
        pairs = self._pairs[chosen].tolist()
        rotations, origins = snapshot.joint_placements
        placed = {
            body: self._placed(body, rotations, origins) for body in np.unique(pairs).tolist()
        }
        for k, pair in enumerate(pairs):
            (one, at, here), (other, there, away) = (placed[body] for body in pair)
            result = coal.DistanceResult()
            coal.distance(one, here, other, away, request, result)
            normal = -result.normal
            if not abs(float(normal @ normal) - 1.0) < UNIT:  # not so if one is not a number
                normal = at.act(one.aabb_center) - there.act(other.aabb_center)
                size = float(np.linalg.norm(normal))
                normal = normal / size if size > TOLERANCE else np.array([0.0, 0.0, 1.0])
            shapes = [self._bodies[body].shape for body in pair]
            # Rounding radii, which coal's shapes do not include.
            first, second = (0.0 if isinstance(s, Capsule) else s.radius for s in shapes)
            found[0, k], found[1:4, k] = result.min_distance - first - second, normal
            found[4:, k] = result.getNearestPoint1() - first * normal
        return found

    def _placed(
        self, body: int, rotations: Array, origins: Array
    ) -> tuple[coal.ShapeBase, pin.SE3, coal.Transform3s]:
        """Return coal's shape of a body, and its placement for Pinocchio and for coal."""
        if body not in self._shapes:
            self._shapes[body] = _geometry(self._bodies[body])
        (shape, place), joint = self._shapes[body], self._bodies[body].joint
        pose = pin.SE3(*self._moved.get(body, (rotations[joint], origins[joint]))) * place
        return shape, pose, coal.Transform3s(pose.rotation, pose.translation)


def _geometry(body: Body) -> tuple[coal.ShapeBase, pin.SE3]:
    """Return coal's shape and its placement in the joint's frame."""
    shape, place = body.shape, pin.SE3.Identity()
    if isinstance(shape, Capsule):
        axis = shape.ends[1] - shape.ends[0]
        length, place.translation = float(np.linalg.norm(axis)), shape.ends.mean(axis=0)
        geometry = coal.Sphere(shape.radius)
        if length >= TOLERANCE:
            turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis / length)
            geometry, place.rotation = coal.Capsule(shape.radius, length), turn.toRotationMatrix()
    else:
        geometry = convex(shape.core)
    geometry.computeLocalAABB()
    return geometry, place


class RawPairs:
    """The raw shapes (meshes) of pairs of bodies, which fitted ones exceed, maybe by centimetres.

    ``bodies``, ``pairs``: as a :class:`~wbc.robot.collision.CollisionModel` has them.
    """

    def __init__(self, robot: Robot, bodies: Sequence[Body], pairs: Index) -> None:
        self.robot, self._data = robot, robot.model.createData()
        self._bodies, self._numbers = bodies, pairs
        self._hulls = dict[str, tuple[object, float]]()  # around meshes, made on demand

    @cached_property
    def _pairs(self) -> list[list[pin.GeometryObject]]:
        named = {name: shape for name, _, shape in named_shapes(self.robot)}
        # Bodies in several parts are named BODY/PART, and are one shape; links may hold a / too.
        names = [
            body.link + body.name.removeprefix(body.link).partition("/")[0] for body in self._bodies
        ]
        return [[named[names[k]] for k in both] for both in self._numbers.tolist()]

    def violations(self, q: Array, pairs: Sequence[int], margins: Array) -> Array:
        """Return violations of margins (N,) [m] by some pairs: (k, 7), zeros if not violated.

        The violation [m], the unit vector from the second body to the first, zero if they touch,
        and the nearest point of the first.
        """
        pin.forwardKinematics(self.robot.model, self._data, q)
        return np.array([self._violation(k, float(margins[k])) for k in pairs])

    def _violation(self, k: int, margin: float) -> Array:
        found, result = np.zeros(7), coal.DistanceResult()
        solids, hulls, round_them = list[object](), list[object](), 0.0
        for shape in self._pairs[k]:
            T = self._data.oMi[shape.parentJoint] * shape.placement
            place = coal.Transform3s(T.rotation, T.translation)
            hull, radius = self._hull(shape)
            solids += [shape.geometry, place]
            hulls += [hull, place]
            round_them += radius
        # Meshes take a hundred times as long as hulls around them, which show for most pairs that
        # no margin is violated.
        if coal.distance(*hulls, coal.DistanceRequest(), result) > margin + round_them + ROUNDING:
            return found
        result.clear()
        distance = float(coal.distance(*solids, coal.DistanceRequest(), result))
        if distance <= margin:
            found[0] = margin - distance
            a, b = result.getNearestPoint1(), result.getNearestPoint2()
            if distance > CONTACT:  # meshes have no normal
                found[1:4] = (a - b) / np.linalg.norm(a - b)
            found[4:] = a
        return found

    def _hull(self, shape: pin.GeometryObject) -> tuple[object, float]:
        """Return a convex shape and its rounding radius [m] that contain a raw one."""
        name = str(shape.name)
        if name not in self._hulls:
            mesh = self.robot.collision_surfaces.meshes.get(name)
            if mesh is None:
                self._hulls[name] = shape.geometry, 0.0
            else:
                hull = fit_close_hull(mesh.vertices, HULL_TOLERANCE).shape
                self._hulls[name] = convex(hull.core), hull.radius
        return self._hulls[name]
