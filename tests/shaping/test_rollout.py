"""How a motion to a posture ends: at rest, by giving up, out of time; with scripted controllers."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wbc.constraints import Limits
from wbc.robot import Robot
from wbc.shaping.motion import INTERRUPTED, PostureReach
from wbc.shaping.outcome import Candidate, Kept
from wbc.shaping.problem import ShapingProblem
from wbc.tasks import InertiaTask

DT = 0.1
GUIDED = 25  # ticks: two seconds on the way, half a second more at its end

Script = Callable[[int], tuple[float, bool]]  # by tick: speed, and whether it is solved


class Controller:
    """Commands one joint as scripted; counts the ticks of both controllers together."""

    def __init__(self, robot: Robot, script: Script, log: list) -> None:
        self.robot, self.dt, self.script, self.log = robot, DT, script, log

    def step(self, snapshot) -> Any:
        speed, ok = self.script(len(self.log))
        self.log.append(self)
        v = np.zeros(self.robot.nv)
        v[7] = speed
        return SimpleNamespace(velocity=v, ok=ok, report=lambda: "no way")


@pytest.fixture
def robot(robot_named) -> Robot:
    return robot_named("hoap2_like")


def rollout(robot: Robot, script: Script, *, longest=None, rest_speed=1e-5, watch=None):
    q = robot.posture()
    task = InertiaTask(robot, np.eye(3), frame="base")
    problem = ShapingProblem(robot, (task,), (), Limits(robot), ())
    log: list[Controller] = []
    made: list[tuple[str, ...]] = []

    def make(tasks) -> Controller:
        made.append(tuple(one.name for one in tasks))
        return Controller(robot, script, log)

    reach = PostureReach(problem, q, 0.01, DT, longest, rest_speed, make, watch)  # type: ignore[arg-type]
    kept = Kept(0.0, 1.0, None, None, ())
    found = reach._rollout(Candidate(q, 1.0, {}, kept, "ok", True, 1, (0,)), 3)
    assert made == [("guide: posture",), ("inertia",)]
    guides = [one is log[0] for one in log]
    assert guides == [k < GUIDED for k in range(len(log))], "then the problem's own tasks"
    assert len(found.states) == len(log) + 1
    return found


def test_ten_ticks_at_rest_end_it_after_the_guides(robot) -> None:
    found = rollout(robot, lambda k: (0.0, True))
    assert (len(found.states), found.at_rest, found.fault) == (GUIDED + 10 + 1, True, "")
    # A tick that moves, or is not solved, begins the count anew; just below the speed is at rest.
    for bad in ((1.01e-5, True), (0.0, False)):
        script = lambda k, bad=bad: bad if k == GUIDED + 9 else (0.99e-5, True)  # noqa: E731
        found = rollout(robot, script)
        assert (len(found.states), found.at_rest) == (GUIDED + 20 + 1, True)
    found = rollout(robot, lambda k: (0.0, True), rest_speed=None)
    assert (len(found.states), found.at_rest) == (60 + 1, False), "two seconds and four more"


def test_time_is_over_after_so_many_ticks(robot) -> None:
    moving = lambda k: (0.01, True)  # noqa: E731
    for longest, ticks in ((None, 60), (3.0, 30), (3.04, 31), (0.01, 1)):
        found = rollout(robot, moving, longest=longest)
        assert (len(found.states), found.at_rest, found.fault) == (ticks + 1, False, "")
    for k, state in enumerate(found.states):  # each state follows from the one before it
        assert robot.difference(robot.posture(), state.q)[7] == pytest.approx(0.01 * DT * k)


def test_ten_ticks_in_a_row_without_solution_end_it(robot) -> None:
    found = rollout(robot, lambda k: (0.0, k < 5))
    assert len(found.states) == 15 + 1 and found.fault == "at 1.40 s: no way"
    found = rollout(robot, lambda k: (0.01, k % 10 != 0))
    assert found.fault == "" and len(found.states) == 61


def test_who_watches_may_end_it(robot) -> None:
    seen: list[tuple[int, float]] = []

    def watch(number: int, tick) -> bool:
        seen.append((number, tick.time))
        return len(seen) == 7

    found = rollout(robot, lambda k: (0.01, True), watch=watch)
    assert found.fault == INTERRUPTED and len(found.states) == 7 + 1
    np.testing.assert_allclose(seen, [(3, DT * k) for k in range(7)])
