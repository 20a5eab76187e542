"""What is no part of a controller is refused by a typed error, and nothing is taken silently."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from wbc import (
    ComSupport,
    ComTask,
    Contact,
    KinematicController,
    Limits,
    Obstacle,
    Obstacles,
    PositionBox,
    PostureTask,
    Robot,
    SelfCollision,
    WbcError,
    support,
)

ROBOT = Robot.load("hoap2_like")
START = ROBOT.snapshot(ROBOT.posture())
CALM = PostureTask(ROBOT, START.q)
BALL = Obstacle.sphere("ball", (1.0, 0.0, 0.0), 0.1)
NO_ROBOT: Any = "hoap2_like"


def made(tasks: Any = (CALM,), **parts: Any) -> KinematicController:
    return KinematicController(ROBOT, tasks, **parts)


BAD: dict[str, tuple[Callable[[], Any], str]] = {
    "a support mode": (lambda: made(contacts="double"), "makes contacts"),
    "words": (lambda: made(constraints=["x"]), "the list has 'x'"),
    "one task": (lambda: made(CALM), "expected a list, got one"),
    "another robot of the same name": (
        lambda: made().step(Robot.load("hoap2_like").snapshot(START.q)),
        "made by the robot object that the controller was made with",
    ),
    "a configuration": (lambda: made().step(START.q), "expected a snapshot"),
    "slack": (lambda: made(slack="left_sole"), "expected weights by name"),
    "dt": (lambda: made(dt="0.005"), "expected a number, got '0.005'"),
    "robot": (lambda: KinematicController(NO_ROBOT, [CALM]), "expected a robot"),
    "robot of a task": (lambda: ComTask(NO_ROBOT, START.com), "expected a robot"),
    "robot of a posture": (lambda: PostureTask(NO_ROBOT, START.q), "expected a robot"),
    "robot of a contact": (
        lambda: Contact(NO_ROBOT, "left_sole", np.zeros(3), np.eye(3)),
        "expected a robot",
    ),
    "robot of limits": (lambda: Limits(NO_ROBOT), "expected a robot"),
    "robot of bodies": (lambda: SelfCollision(NO_ROBOT), "expected a robot"),
    "robot of a box": (lambda: PositionBox.height(NO_ROBOT, 0.1), "expected a robot"),
    "pairs": (lambda: SelfCollision(ROBOT, pairs="x"), "expected a number"),  # type: ignore[arg-type]
    "one obstacle": (lambda: Obstacles(ROBOT, BALL), "a list of Obstacle"),  # type: ignore[arg-type]
    "polygon": (lambda: ComSupport(ROBOT, "abc"), "expected numbers"),  # type: ignore[arg-type]
    "support of q": (lambda: support(START.q, "double"), "expected a snapshot"),  # type: ignore[arg-type]
    "support 3": (lambda: support(START, 3), "expected a mode"),  # type: ignore[arg-type]
    "a snapshot's com": (lambda: setattr(START, "com", np.zeros(3)), "cannot be assigned"),
    "quaternion": (
        lambda: ROBOT.snapshot(np.r_[START.q[:3], 1, 1, 0, 1, START.q[7:]]),
        "quaternion",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_a_typed_error(name: str) -> None:
    call, words = BAD[name]
    with pytest.raises(WbcError, match=words):
        call()
