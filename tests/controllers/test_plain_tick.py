"""A plain tick can be read: it crosses few files and functions of the package."""

import sys
from pathlib import Path
from types import FrameType

import wbc
from wbc.constraints import Limits, support
from wbc.controllers import KinematicController
from wbc.robot import Robot
from wbc.tasks import ComTask, PostureTask

FILES, FUNCTIONS = 11, 30
PACKAGE = str(Path(wbc.__file__).parent)


def test_a_plain_tick_crosses_few_files_and_functions() -> None:
    """CoM, posture, two contacts, limits, warm solver. Pink with qpsolvers: 13, 29."""
    robot = Robot.load("g1")
    q = robot.posture("standing")
    here = robot.snapshot(q, 0.0 * robot.snapshot(q).v)
    tasks = [ComTask(robot, here.com + 0.001, weight=10.0), PostureTask(robot, q, weight=0.1)]
    limits = Limits(robot)
    for solver in ("proxqp", "active_set"):
        controller = KinematicController(
            robot, tasks, contacts=support(here, "double"), limits=limits, solver=solver
        )
        for _ in range(3):
            assert controller.step(robot.snapshot(q, here.v)).ok
        fresh, crossed = robot.snapshot(q, here.v), set[tuple[str, str]]()

        def note(frame: FrameType, event: str, _: object, crossed: set = crossed) -> None:
            path = frame.f_code.co_filename
            if event == "call" and path.startswith(PACKAGE):
                crossed.add((path, frame.f_code.co_qualname))

        sys.setprofile(note)
        try:
            controller.step(fresh)
        finally:
            sys.setprofile(None)
        assert len({path for path, _ in crossed}) <= FILES
        assert 5 < len(crossed) <= FUNCTIONS
