"""Bodies that are to stay apart: those of the robot, and the obstacles where they are now."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from wbc.constraints.rows import Index, SeparatedPairs
from wbc.robot import Robot
from wbc.robot.collision import Body, CollisionModel, HalfSpace
from wbc.robot.symbolic import Placement, SymbolicPosture
from wbc.validate import Array

WORLD = 0  # the joint of what does not hang on the robot


@dataclass(frozen=True, eq=False)
class Bodies:
    """Bodies of all collision constraints of a problem; can be sent to another process.

    Attributes
    ----------
    bodies:
        Shapes in the frames of their joints; a robot's body is there once for each constraint.
    pairs:
        (N, 2) indices of bodies.
    least:
        (N,) distance that each pair keeps [m]: the margin, and the skin that the QP keeps too, so
        that the QP can rest at what is found here.
    places:
        Rotation (3, 3) and origin (3,) of each body that does not hang on the robot.
    """

    robot: Robot
    bodies: tuple[Body, ...]
    pairs: Index
    least: Array
    places: Mapping[int, tuple[Array, Array]]

    @classmethod
    def of(cls, robot: Robot, parts: Sequence[SeparatedPairs]) -> Bodies | None:
        """Return the bodies of several constraints, None if there are no pairs."""
        bodies: list[Body] = []
        pairs, least = [np.zeros((0, 2), dtype=np.int64)], [np.zeros(0)]
        places: dict[int, tuple[Array, Array]] = {}
        for one in parts:
            pairs.append(one.model.pairs + len(bodies))
            least.append(np.full(len(one.model.pairs), one.distance))
            places |= {len(bodies) + k: place for k, place in one.places.items()}
            bodies += one.model.bodies
        numbers = np.concatenate(pairs)
        if not numbers.size:
            return None
        return cls(robot, tuple(bodies), numbers, np.concatenate(least), places)

    def model(self) -> CollisionModel:
        """Return what measures distances, with the obstacles in place."""
        made = CollisionModel(self.robot, self.bodies, [(a, b) for a, b in self.pairs.tolist()])
        for k, place in self.places.items():
            made.place(k, *place)
        return made

    @property
    def joints(self) -> tuple[int, ...]:
        """Pinocchio's indices of the joints that carry bodies, increasing; 0 for the world."""
        return tuple(sorted({body.joint for body in self.bodies}))

    def placements(self, posture: SymbolicPosture) -> ca.SX:
        """Return where :attr:`joints` are as seen from the base (12 each, 1), by columns (R, p).

        So what only the robot's own bodies matter to does not depend on where the base is, and
        chains are short.
        """
        placed = [
            posture.base.inverse() if joint == WORLD else posture.local.joint(joint)
            for joint in self.joints
        ]
        return ca.densify(ca.vertcat(*(_by_columns(one) for one in placed)))

    def corners(self, body: int) -> Array:
        """Return the points (k, 3) whose rounded hull a body is, in its joint's frame [m]."""
        core = self.bodies[body].shape.core
        if body in self.places:
            R, p = self.places[body]
            return np.asarray(core @ R.T + p)
        return core[:1] if np.ptp(core, axis=0).max() == 0.0 else core

    def normal(self, body: int) -> Array | None:
        """Return the outward normal (3,) of a half-space in its joint's frame, None of others."""
        shape = self.bodies[body].shape
        if not isinstance(shape, HalfSpace):
            return None
        return self.places[body][0] @ shape.normal if body in self.places else shape.normal


def _by_columns(place: Placement) -> ca.SX:
    return ca.vertcat(ca.vec(place.rotation), place.position)
