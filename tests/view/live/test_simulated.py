"""Runs and simulations in the viewer are themselves, are pushed from the page and played again."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.problem.loading import problem_of
from tests.view.live.conftest import Stage, Watched, balanced, client_of, simulated_problem, tell
from wbc.problem import load_problem
from wbc.problem.problem import Problem
from wbc.robot import Robot
from wbc.run.result import Result
from wbc.view.live.clock import Clock
from wbc.view.live.collect import controller_info
from wbc.view.live.messages import PUSH_DURATION, Frame, PushRobot, SetTarget, WholeRun
from wbc.view.live.run_viewer import RunViewer, frames_of
from wbc.view.live.session import checked
from wbc.view.live.simulated import SimulatedSession, strongest_push
from wbc.view.live.viewer import Viewer

IMPULSE = np.array([0.3, 0.1, 0.0])
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


def test_a_push_from_the_page_is_one_of_the_file(tmp_path: Path) -> None:
    """What is asked for after ten ticks of 2 ms is the file's push at 0.02 s.

    The file's acts where the CoM was at the start, the page's where it is: some um apart by then.
    """
    one = simulated_problem(tmp_path, "{duration: 0.2}")
    viewer = Watched()
    viewer.asks[10] = PushRobot(IMPULSE)
    SimulatedSession(one, viewer, Clock(0.0)).run(100)  # type: ignore[arg-type]
    pushed = f"{{impulse: {IMPULSE.tolist()}, at: 0.02, duration: {PUSH_DURATION}}}"
    same = simulated_problem(tmp_path, f"{{duration: 0.2, pushes: [{pushed}]}}").simulate()
    found, expected = np.array([q for q, *_ in viewer.seen]), same.run.history.q
    np.testing.assert_allclose(found, expected, atol=1e-5)
    assert np.abs(expected - expected[0]).max() > 1e-3  # what the push does
    forces = np.array([push for _, push, _ in viewer.seen])
    np.testing.assert_allclose(forces.sum(axis=0) * 0.002, IMPULSE, rtol=1e-12)


@pytest.mark.slow
def test_a_fall_is_said_and_restart_begins_again(tmp_path: Path) -> None:
    one = simulated_problem(tmp_path, "{duration: 0.2}")
    viewer = Watched()
    viewer.asks[1] = PushRobot(np.array([0.0, 30.0, 0.0]))
    SimulatedSession(one, viewer, Clock(0.0)).run(400)  # type: ignore[arg-type]
    remarks = [remark for *_, remark in viewer.seen if remark]
    assert remarks and "fell" in remarks[0] and "Restart begins it again" in remarks[0]
    fell = next(k for k, (*_, remark) in enumerate(viewer.seen) if remark)
    np.testing.assert_array_equal(viewer.seen[fell + 1][0], viewer.seen[0][0])


def test_the_strongest_push_is_more_than_what_is_caught_without_a_step(tmp_path: Path) -> None:
    one = simulated_problem(tmp_path, "{duration: 0.2}")
    unit = one.parts.robot.mass * np.sqrt(9.81 / one.parts.robot.snapshot(one.parts.start).com[2])
    assert 0.01 * unit < strongest_push(one) < 0.5 * unit  # the soles' edge is 4 to 20 cm away


def test_a_robot_that_leans_out_of_its_soles_can_be_viewed(tmp_path: Path) -> None:
    """On a steep slope it is turned with the ground: no push is caught without a step."""
    file = tmp_path / "walk.yaml"
    file.write_text(
        "robot: hoap2_like\ngait: {commands: [{at: 0.1, vx: 0.1}]}\n"
        "simulation: {duration: 0.2, terrain: {slope: [0.2, 0]}}\n"
    )
    one = checked(load_problem(file))
    assert strongest_push(one) == pytest.approx(0.5 * one.parts.robot.mass)


@pytest.fixture
def pushed(stages: Callable[..., Stage]) -> Stage:
    return stages(push=2.0)


def test_the_button_sends_what_the_sliders_say(pushed: Stage) -> None:
    with client_of(pushed.url) as client:
        pushed.move_slider(client, "Impulse [N s]", 1.5)
        pushed.move_slider(client, "Direction [deg]", 90.0)
        uuid = pushed.gui("Push")._impl.uuid
        tell(client, "GuiUpdateMessage", uuid=uuid, updates={"value": True})
        assert pushed.pipe.poll(20.0)
        request = pushed.pipe.recv()
    assert isinstance(request, PushRobot)
    np.testing.assert_allclose(request.impulse, [0.0, 1.5, 0.0], atol=1e-12)


def test_the_arrow_is_grey_while_offered_and_red_while_it_acts(pushed: Stage, robot: Robot) -> None:
    arrow = pushed.handle("/push/arrow")
    q = robot.posture("standing")
    pushed.draw(Frame(0.0, q, np.zeros(robot.nv), push=np.zeros(3)))
    grey, offered = tuple(arrow.colors.ravel()), np.diff(arrow.points[0], axis=0).ravel()
    assert arrow.visible
    pushed.draw(Frame(0.1, q, np.zeros(robot.nv), push=np.array([0.0, 10.0, 0.0])))
    red, acting = tuple(arrow.colors.ravel()), np.diff(arrow.points[0], axis=0).ravel()
    assert grey != red
    # 10 N for 0.1 s are 1 N s, twice the quarter of 2 N s that is offered forwards at first.
    np.testing.assert_allclose(np.linalg.norm(acting), 2.0 * np.linalg.norm(offered), rtol=1e-5)
    np.testing.assert_allclose(acting / np.linalg.norm(acting), [0.0, 1.0, 0.0], atol=1e-6)


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
