"""Pairs of bodies by the shapes of a robot's files, where the simple ones in their place are large.

Fitted shapes contain the raw ones (the meshes), some by centimetres.
"""

from __future__ import annotations

from collections.abc import Sequence

import coal
import pinocchio as pin

from wbc.robot.collision.bodies import named_shapes
from wbc.robot.model import Robot
from wbc.validate import Array


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

    def apart(self, q: Array, pairs: Sequence[int], margins: Array) -> bool:
        """Whether some pairs, by their numbers, keep margins (N,) [m] at a configuration (nq,)."""
        pin.forwardKinematics(self.robot.model, self._data, q)
        return not any(self._nearer(k, float(margins[k])) for k in pairs)

    def _nearer(self, k: int, margin: float) -> bool:
        placed = list[object]()
        for shape in self._pairs[k]:
            T = self._data.oMi[shape.parentJoint] * shape.placement
            placed += [shape.geometry, coal.Transform3s(T.rotation, T.translation)]
        request = coal.CollisionRequest()
        request.security_margin = margin
        return bool(coal.collide(*placed, request, coal.CollisionResult()))
