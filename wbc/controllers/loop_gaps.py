"""How far loops are open where a command leads, by the compiled core: in every velocity tick."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wbc.constraints.mechanics import ClosedLoop
from wbc.native import doubles, integers, lib
from wbc.robot import Robot
from wbc.robot.kernel import frame_places
from wbc.robot.loops import gap_at
from wbc.validate import Array

_POSE = 12  # numbers of a frame's origin and rotation


class LoopGaps:
    """Memory for passes over the frames of some loops.

    Parameters
    ----------
    loops:
        At least one.
    """

    def __init__(self, robot: Robot, loops: Sequence[ClosedLoop]) -> None:
        self.tree = tree = robot.native.tree
        names = [name for one in loops for name in one.loop.frames]
        joints, placements = frame_places(robot.model, [robot.frame_id(name) for name in names])
        self._poses = [len(one.rows) > 3 for one in loops]
        self._state = np.zeros(tree.frames + len(names) * tree.frame_size)
        self._places = self._state[tree.frames :].reshape(-1, tree.frame_size)[:, :_POSE]
        self._q, self._rest = np.zeros(tree.nq), np.zeros(tree.nv)
        scratch = np.zeros(13 * tree.joints + 17 * tree.nv)
        self._kept = joints, placements, scratch  # what the pointers point at
        self._frames = len(names), integers(joints), doubles(placements)
        self._arguments = doubles(self._state), doubles(scratch)

    def after(self, q: Array, step: Array) -> list[Array]:
        """Return the gaps (3,) or (6,) of all loops where a displacement (nv,) leads from ``q``."""
        tree, there = self.tree.struct, doubles(self._q)
        lib.wbc_integrate(tree, doubles(q), doubles(step), there)
        lib.wbc_state(tree, there, doubles(self._rest), *self._arguments, *self._frames)
        origins, turns = self._places[:, :3], self._places[:, 3:].reshape(-1, 3, 3)
        arms = origins[::2] - origins[1::2]
        points = np.einsum("kji,kj->ki", turns[1::2], arms)
        return [
            gap_at((origins[2 * k], turns[2 * k]), (origins[2 * k + 1], turns[2 * k + 1]))
            if pose
            else points[k]
            for k, pose in enumerate(self._poses)
        ]
