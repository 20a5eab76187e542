"""Distances of a robot's bodies by the shapes of its files: the reference for margins."""

from collections.abc import Sequence
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from wbc.constraints import SelfCollision
from wbc.robot import Robot
from wbc.robot.collision.bodies import named_shapes

ROUNDING = 1e-6  # m: of Coal's distances


class RawShapes:
    """The shapes of a robot's files, placed by Pinocchio and measured by Coal."""

    def __init__(self, robot: Robot, margins: SelfCollision) -> None:
        self.robot, self.data = robot, robot.model.createData()
        named = {name: shape for name, _, shape in named_shapes(robot)}
        for shape in named.values():
            shape.geometry.computeLocalAABB()
        names = list(named)
        self.shapes = list(named.values())
        self.centres = np.array([shape.geometry.aabb_center for shape in self.shapes])
        radii = np.array([shape.geometry.aabb_radius for shape in self.shapes])
        kept: dict[tuple[int, int], float] = {}  # the least margin of two shapes' parts
        for label, margin in zip(margins.model.labels, margins.margins, strict=True):
            a, b = (names.index(body.partition("/")[0]) for body in label.split(" vs "))
            kept[a, b] = min(kept.get((a, b), np.inf), float(margin))
        self.pairs = np.array(list(kept))
        self.margins = np.array(list(kept.values()))
        self.radii = radii[self.pairs].sum(axis=1)

    def broken(self, q: np.ndarray) -> tuple[float, str]:
        """Return the largest violation of a margin [m], and its pair; 0 if there is none."""
        solids, bound = self._placed(q)
        worst = 0.0, ""
        for k in np.flatnonzero(bound < self.margins):
            pair = [solids[i] for i in self.pairs[k]]
            request = coal.CollisionRequest()
            request.security_margin = float(self.margins[k]) - ROUNDING
            if not coal.collide(*pair[0], *pair[1], request, coal.CollisionResult()):
                continue
            worst = max(worst, (float(self.margins[k]) - _distance(pair), self.label(k)))
        return worst

    def nearest(self, q: np.ndarray, among: np.ndarray) -> tuple[float, str]:
        """Return the least distance [m] of pairs ``among`` (a mask), and which; 0 if they meet."""
        solids, bound = self._placed(q)
        best = np.inf, ""
        for k in np.argsort(bound):
            if bound[k] >= best[0]:
                break
            if among[k]:
                best = min(best, (_distance([solids[i] for i in self.pairs[k]]), self.label(k)))
        return max(best[0], 0.0), best[1]

    def distances(self, q: np.ndarray) -> np.ndarray:
        """Return the distances of all pairs [m]; 0 or less where they meet."""
        solids, _ = self._placed(q)
        return np.array([_distance([solids[i] for i in pair]) for pair in self.pairs])

    def label(self, k: int) -> str:
        """Return the name of a pair."""
        first, second = (self.shapes[i].name for i in self.pairs[k])
        return f"{first} vs {second}"

    def _placed(self, q: np.ndarray) -> tuple[list[tuple[Any, Any]], np.ndarray]:
        """Return shapes with their places, and least distances of pairs, by balls about them."""
        pin.forwardKinematics(self.robot.model, self.data, q)
        poses = [self.data.oMi[shape.parentJoint] * shape.placement for shape in self.shapes]
        centres = [pose.act(c) for pose, c in zip(poses, self.centres, strict=True)]
        first, second = np.array(centres)[self.pairs.T]
        solids = [
            (shape.geometry, coal.Transform3s(pose.rotation, pose.translation))
            for shape, pose in zip(self.shapes, poses, strict=True)
        ]
        return solids, np.linalg.norm(first - second, axis=1) - self.radii


def _distance(pair: Sequence[tuple[Any, Any]]) -> float:
    return float(coal.distance(*pair[0], *pair[1], coal.DistanceRequest(), coal.DistanceResult()))
