"""A human's motion on a robot in the browser, the human beside it."""

from __future__ import annotations

from pathlib import Path

from wbc.human import HumanMotion
from wbc.retargeting import Retargeted
from wbc.retargeting.side_by_side import human_beside
from wbc.view.live.messages import Frame
from wbc.view.live.process import HOST
from wbc.view.live.viewer import Viewer


def view_retargeted(
    human: HumanMotion, motion: Retargeted, *, host: str = HOST, port: int | None = None
) -> Viewer:
    """Return a page that plays a motion, with the human beside; close it, or ``wait`` for Ctrl-C.

    Raises
    ------
    MissingPackageError
        viser is not installed.
    InvalidInputError
        A port that is in use.
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
