"""The human of a retargeted motion beside its robot, at the same times."""

from __future__ import annotations

import numpy as np

from wbc.errors import InvalidInputError
from wbc.human import HumanMotion
from wbc.human.contacts import nearest_rows
from wbc.retargeting.result import Retargeted
from wbc.rotations import headings, rotation_from
from wbc.validate import Array

DISTANCE = 1.0  # m to the robot's right, where the motion begins; for robots of a human's size


def human_beside(human: HumanMotion, motion: Retargeted) -> Array:
    """Return the human's configurations (n, nq) at the frames of its robot's motion.

    In its own size, on the robot's ground, moved to the right of where the robot begins.

    Raises
    ------
    InvalidInputError
        A motion of joints alone: where its base was is not known.
    """
    recorded, base = human.motion, human.motion.base
    if base is None:
        raise InvalidInputError("human beside the robot: its motion has no base, only joints")
    own = motion.time / motion.scale.time
    # As much of the recording is left out at its beginning as at its end.
    first = 0.5 * float(recorded.time[0] + recorded.time[-1] - own[-1])
    q = np.hstack((base, recorded.joints))[nearest_rows(recorded.time, first + own)]
    (heading,) = headings(rotation_from(motion.q[0, 3:7])[None])
    right = np.array((np.sin(heading), -np.cos(heading)))
    height = float(motion.targets.com[0, 2])
    distance = DISTANCE * max(height / motion.scale.human_height, 0.5)
    q[:, :2] += motion.q[0, :2] + distance * right - q[0, :2]
    q[:, 2] -= human.ground_height
    return q
