"""Fingers are fixed in their standing posture, and a motion is found for all other joints.

Each pair of fingers would be a margin in every frame, and each joint a column.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wbc.errors import listed
from wbc.retargeting.body_map import BodyMap
from wbc.robot import Robot
from wbc.robot.formats.description import reduced_model
from wbc.robot.limits import JointLimits
from wbc.robot.postures import STANDING
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class FixedFingers:
    """A robot with rigid fingers, and its configurations with movable ones.

    Attributes
    ----------
    robot:
        With rigid fingers; the same robot if it has none.
    fingers:
        Their joints, by name.
    standing:
        Configuration (nq,) of the whole robot, in which fingers are fixed.
    q_kept, v_kept:
        Indices of the whole robot's coordinates and velocities that the rigid one has.
    """

    robot: Robot
    fingers: tuple[str, ...]
    standing: Array
    q_kept: NDArray[np.intp]
    v_kept: NDArray[np.intp]

    @classmethod
    def of(cls, robot: Robot, body: BodyMap) -> FixedFingers:
        """Fix the fingers of a robot whose hands are known."""
        fingers, model = _fingers(robot, body), robot.model
        others = [joint for joint in range(1, model.njoints) if joint not in fingers]
        q = np.concatenate([model.idx_qs[joint] + np.arange(model.nqs[joint]) for joint in others])
        v = np.concatenate([model.idx_vs[joint] + np.arange(model.nvs[joint]) for joint in others])
        names = tuple(str(model.names[joint]) for joint in fingers)
        rigid = _rigid(robot, names, q) if names else robot
        return cls(rigid, names, robot.postures[STANDING], q, v)

    @property
    def notes(self) -> tuple[str, ...]:
        """Which fingers are fixed."""
        if not self.fingers:
            return ()
        return (f"fingers are held as they stand, {len(self.fingers)}: {listed(self.fingers, 4)}",)

    def all_joints(self, q: Array) -> Array:
        """Return configurations of the whole robot (n, nq) from those without fingers."""
        every = np.tile(self.standing, (len(q), 1))
        every[:, self.q_kept] = q
        return every


def _fingers(robot: Robot, body: BodyMap) -> list[int]:
    """Return the joints behind the first link of a hand that carries several."""
    parents = [int(p) for p in robot.model.parents]
    found = set[int]()
    for arm in body.arms.values():
        joint = robot.frame(arm.hand).parentJoint
        while parents.count(joint) == 1:
            joint = parents.index(joint)
        for other in range(joint + 1, len(parents)):  # joints come after those that carry them
            if parents[other] == joint or parents[other] in found:
                found.add(other)
    names = {str(robot.model.names[joint]) for joint in found}
    for follower, coupling in robot.couplings.items():
        if (follower in names) != (coupling.driver in names):
            return []  # such as a hand that closes as its wrist turns
    return sorted(found)


def _rigid(robot: Robot, joints: Collection[str], kept: NDArray[np.intp]) -> Robot:
    """Return a robot with some joints fixed as it stands; ``kept``: its remaining coordinates."""
    model = reduced_model(robot.model, joints, robot.postures[STANDING])
    limits = JointLimits.of(model)
    return replace(
        robot,
        model=model,
        limits=limits,
        couplings={name: one for name, one in robot.couplings.items() if name not in joints},
        unactuated=tuple(name for name in robot.unactuated if name not in joints),
        passive=robot.passive.of(model, limits),
        postures={name: q[kept] for name, q in robot.postures.items()},
    )
