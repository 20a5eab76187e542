"""A run that is watched is the run itself, and can be played again whole."""

import numpy as np
import pytest

from tests.problem.loading import problem_of
from tests.view.live.conftest import balanced
from wbc.problem.problem import Problem
from wbc.robot import Robot
from wbc.run.result import Result
from wbc.view.live.collect import controller_info
from wbc.view.live.messages import SetTarget, WholeRun
from wbc.view.live.run_viewer import RunViewer, frames_of
from wbc.view.live.viewer import Viewer

SHIFT = """
robot: hoap2_like
start: {posture: standing}
tasks:
  com: {type: com, target: start, weight: 10.0}
  posture: {type: posture, target: start, weight: 0.01}
phases:
  both: {duration: 0.5, support: double, tasks: {com: {target: {offset: [0, 0.01, 0]}}}}
  left: {duration: 0.5, support: left}
"""


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    loaded = problem_of(tmp_path_factory.mktemp("shift"), SHIFT)
    assert isinstance(loaded, Problem)
    return loaded


@pytest.fixture(scope="module")
def alone(problem: Problem) -> Result:
    return problem.run()


@pytest.mark.slow
def test_it_is_the_same_run(problem, alone, monkeypatch) -> None:
    """To the bit, even if somebody tries to steer."""
    watching = RunViewer(problem.parts.robot)
    viewer = watching.viewer
    viewer._page.receive = lambda: SetTarget("com", (np.zeros(3),))  # type: ignore[method-assign]
    try:
        result = problem.run(show=watching.show)
        assert viewer._put == len(result.history)
        assert not viewer.has_wishes
        watching.replay(result.history)
    finally:
        viewer.close()
    np.testing.assert_array_equal(result.history.q, alone.history.q)


def test_frames_of_a_run(alone: Result) -> None:
    history = alone.history
    frames = frames_of(history, rate=50.0)
    dt = history.time[1]
    np.testing.assert_allclose(np.diff([one.time for one in frames]), 0.02)
    for one in frames[:: len(frames) // 10]:
        k = round(one.time / dt)
        np.testing.assert_array_equal(one.q, history.q[k])
        assert one.phase == history.phase[k]
        assert one.told is not None
        assert one.told.ok
        assert one.told.active is None
    moving = frames[len(frames) // 2]
    k = round(moving.time / dt)
    step = alone.robot.difference(history.q[k - 1], history.q[k]) / dt
    np.testing.assert_allclose(moving.v, step, atol=1e-9)  # that with which it came there
    assert not np.isnan(np.concatenate(list(frames[0].told.errors.values()))).any()  # type: ignore[union-attr]


def test_a_replay_takes_the_place_of_what_was_seen(stage, problem, alone) -> None:
    """And knows of each time who was held then."""
    frames = frames_of(alone.history)
    robot = stage.page._robot
    one, other = balanced(robot), balanced(robot, "left")
    late = next(k for k, frame in enumerate(frames) if frame.time > 0.5)
    stage.draw(controller_info(one), frames[0], controller_info(other), frames[late])
    stage.draw(WholeRun(tuple(frames)))
    stage.page._controls._replaying = False
    polygon = stage.handle("/soles_and_support/polygon")
    held = []
    for time in (0.3, 0.8):
        stage.page._controls.past = time
        stage.draw()
        held.append(len(polygon.points))
        found = stage.page._recording.at(time)
        assert found is not None
        com = robot.snapshot(found[0].q).com
        np.testing.assert_allclose(stage.handle("/com/com").position, com, atol=1e-9)
    assert held == [6, 4]


@pytest.mark.slow
def test_a_viewer_that_may_not_steer_leaves_tasks_alone(hoap2: Robot) -> None:
    with Viewer(hoap2, balanced(hoap2), steer=False, quiet=True) as viewer:
        viewer.update(hoap2.snapshot(hoap2.posture("standing")))
        assert not viewer.steering
