"""A human's motion on a robot in the browser, the human beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wbc.errors import InvalidInputError
from wbc.human import HumanMotion
from wbc.human.contacts import nearest_rows
from wbc.retargeting.result import Retargeted
from wbc.rotations import headings, rotation_from
from wbc.validate import Array
from wbc.view.live.messages import Frame
from wbc.view.live.process import HOST
from wbc.view.live.viewer import Viewer

DISTANCE = 1.0  # m to the robot's right, where the motion begins; for robots of a human's size


def human_beside(human: HumanMotion, motion: Retargeted) -> Array:
    """Return the human's configurations (n, nq) at the frames of its robot's motion.

    In its own size, on the robot's ground, moved to the right of where the robot begins.

    Raises InvalidInputError: a motion of joints alone: where its base was is not known.
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


def view_retargeted(
    human: HumanMotion, motion: Retargeted, *, host: str = HOST, port: int | None = None
) -> Viewer:
    """Return a page that plays a motion, with the human beside; close it, or ``wait`` for Ctrl-C.

    Raises MissingPackageError: viser is not installed; InvalidInputError: a port that is in use.
    """
    beside = human_beside(human, motion)
    title = f"{motion.robot.name} as {Path(motion.source).name}"
    viewer = Viewer(
        motion.robot, host=host, port=port, title=title, steer=False, beside=human.motion.robot
    )
    stands = [
        " and ".join(n for n, on in zip(("left", "right"), row, strict=True) if on) or "in the air"
        for row in motion.contacts.tolist()
    ]
    viewer.replay(
        [
            Frame(float(t), q, v, phase=phase, playing=True, beside=other)
            for t, q, v, phase, other in zip(
                motion.time, motion.q, motion.v, stands, beside, strict=True
            )
        ]
    )
    return viewer
