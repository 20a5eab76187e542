"""Pairs of bodies by the shapes of a robot's files, where the simple ones in their place are large.

Fitted shapes contain the raw ones (the meshes), some by centimetres.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import coal
import numpy as np
import pinocchio as pin

from wbc.robot.collision.bodies import named_shapes
from wbc.robot.collision.fitting import convex, fit_close_hull
from wbc.robot.model import Robot
from wbc.validate import Array

MEETING = 1e-6  # m
CLOSE, SURELY = 1e-3, 1e-5  # m: how close hulls are to meshes, and rounding of Coal's distances


class RawPairs:
    """The raw shapes of pairs of bodies.

    Parameters
    ----------
    labels:
        Of the pairs, as a :class:`~wbc.robot.collision.CollisionModel` has them.
    """

    def __init__(self, robot: Robot, labels: Sequence[str]) -> None:
        self.robot, self._data = robot, robot.model.createData()
        self._labels = labels
        self._hulls = dict[str, tuple[object, float]]()  # round the meshes, as they are asked for

    @cached_property
    def _pairs(self) -> list[list[pin.GeometryObject]]:
        named = {name: shape for name, _, shape in named_shapes(self.robot)}
        # Bodies in several parts are named BODY/PART, and are one shape.
        return [
            [named[name.partition("/")[0]] for name in label.split(" vs ")]
            for label in self._labels
        ]

    def too_near(self, q: Array, pairs: Sequence[int], margins: Array) -> Array:
        """Return how near some pairs are that break margins (N,) [m]: (k, 7), zeros of others.

        By how much [m], the unit vector from the second body to the first, zero where they meet,
        and the nearest point of the first.
        """
        pin.forwardKinematics(self.robot.model, self._data, q)
        return np.array([self._too_near(k, float(margins[k])) for k in pairs])

    def _too_near(self, k: int, margin: float) -> Array:
        found, result = np.zeros(7), coal.DistanceResult()
        solids, hulls, round_them = list[object](), list[object](), 0.0
        for shape in self._pairs[k]:
            T = self._data.oMi[shape.parentJoint] * shape.placement
            place = coal.Transform3s(T.rotation, T.translation)
            hull, radius = self._hull(shape)
            solids += [shape.geometry, place]
            hulls += [hull, place]
            round_them += radius
        # Meshes take a hundred times as long as hulls round them, which most pairs that are near
        # by their fitted shapes do not break a margin by.
        if coal.distance(*hulls, coal.DistanceRequest(), result) > margin + round_them + SURELY:
            return found
        result.clear()
        distance = float(coal.distance(*solids, coal.DistanceRequest(), result))
        if distance <= margin:
            found[0] = margin - distance
            a, b = result.getNearestPoint1(), result.getNearestPoint2()
            if distance > MEETING:  # meshes have no normal
                found[1:4] = (a - b) / np.linalg.norm(a - b)
            found[4:] = a
        return found

    def _hull(self, shape: pin.GeometryObject) -> tuple[object, float]:
        """Return a convex shape and its radius [m], together round a raw one."""
        name = str(shape.name)
        if name not in self._hulls:
            mesh = self.robot.collision_surfaces.meshes.get(name)
            if mesh is None:
                self._hulls[name] = shape.geometry, 0.0
            else:
                hull = fit_close_hull(mesh.vertices, CLOSE).shape
                self._hulls[name] = convex(hull.core), hull.radius
        return self._hulls[name]
