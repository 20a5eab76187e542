"""Pairs of bodies by the shapes of a robot's files, where the simple ones in their place are large.

Fitted shapes contain the raw ones (the meshes), some by centimetres.
"""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np
import pinocchio as pin

from wbc.robot.collision.bodies import named_shapes
from wbc.robot.model import Robot
from wbc.validate import Array

MEETING = 1e-6  # m


class RawPairs:
    """The raw shapes of pairs of bodies.

    Parameters
    ----------
    labels:
        Of the pairs, as a :class:`~wbc.robot.collision.CollisionModel` has them.
    """

    def __init__(self, robot: Robot, labels: Sequence[str]) -> None:
        self.robot, self._data = robot, robot.model.createData()
        named = {name: shape for name, _, shape in named_shapes(robot)}
        # Bodies in several parts are named BODY/PART, and are one shape.
        names = [[one.partition("/")[0] for one in label.split(" vs ")] for label in labels]
        self._pairs = [tuple(named[name] for name in pair) for pair in names]

    def too_near(self, q: Array, pairs: Sequence[int], margins: Array) -> Array:
        """Return how near some pairs are that break margins (N,) [m]: (k, 7), zeros of others.

        By how much [m], the unit vector from the second body to the first, zero where they meet,
        and the nearest point of the first.
        """
        pin.forwardKinematics(self.robot.model, self._data, q)
        return np.array([self._too_near(k, float(margins[k])) for k in pairs])

    def _placed(self, k: int) -> list[object]:
        placed = list[object]()
        for shape in self._pairs[k]:
            T = self._data.oMi[shape.parentJoint] * shape.placement
            placed += [shape.geometry, coal.Transform3s(T.rotation, T.translation)]
        return placed

    def _too_near(self, k: int, margin: float) -> Array:
        found, solids = np.zeros(7), self._placed(k)
        request = coal.CollisionRequest()
        request.security_margin = margin
        if coal.collide(*solids, request, coal.CollisionResult()):  # meshes' distances take long
            result = coal.DistanceResult()
            distance = coal.distance(*solids, coal.DistanceRequest(), result)
            found[0] = max(margin - float(distance), 0.0)
            a, b = result.getNearestPoint1(), result.getNearestPoint2()
            if distance > MEETING:  # meshes have no normal
                found[1:4] = (a - b) / np.linalg.norm(a - b)
            found[4:] = a
        return found
