"""Distances of pairs of bodies by the raw shapes (meshes) of a robot's files.

Fitted shapes contain the raw ones, and may exceed them by centimetres.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import coal
import numpy as np
import pinocchio as pin

from wbc.robot.collision.bodies import named_shapes
from wbc.robot.collision.fitting import convex, fit_close_hull
from wbc.robot.collision.shapes import Body
from wbc.robot.model import Robot
from wbc.validate import Array, Index

CONTACT = 1e-6  # m
HULL_TOLERANCE, ROUNDING = 1e-3, 1e-5  # m: of hulls around meshes, and of Coal's distances


class RawPairs:
    """The raw shapes of pairs of bodies.

    Parameters
    ----------
    bodies, pairs:
        As a :class:`~wbc.robot.collision.CollisionModel` has them.
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
