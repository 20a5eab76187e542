"""Pulls by hand: grabbed on the page, a spring in the simulation, drawn as an arrow, let go."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from websockets.sync.client import ClientConnection

from tests.view.live.conftest import Stage, Watched, client_of, simulated_problem, tell
from wbc.robot import Robot
from wbc.view.live.clock import Clock
from wbc.view.live.messages import Frame, PullRobot, ReleasePull
from wbc.view.live.simulated import SimulatedSession, pull_force

HAND, POINT, STIFFNESS = "left_hand_link", np.array([0.0, 0.01, 0.02]), 60.0


def placed(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Return where the pulled point is (3,)."""
    s = robot.snapshot(q)
    return s.position(HAND) + s.rotation(HAND) @ POINT


@pytest.mark.slow
def test_a_pull_is_a_spring_until_it_is_let_go(tmp_path: Path) -> None:
    one = simulated_problem(tmp_path, "{duration: 0.2}")
    robot = one.parts.robot
    target = placed(robot, one.parts.start) + [0.05, 0.0, 0.02]
    viewer = Watched()
    viewer.asks |= {10: PullRobot(HAND, POINT, target, STIFFNESS), 200: ReleasePull()}
    SimulatedSession(one, viewer, Clock(0.0)).run(700)  # type: ignore[arg-type]
    points = np.array([placed(robot, q) for q, *_ in viewer.seen])
    acting = [k for k, pull in enumerate(viewer.pulls) if pull is not None]
    assert acting == list(range(10, 200))
    for k in acting:  # seen at the end of a period: the state that the next one is measured in
        pull = viewer.pulls[k]
        assert pull is not None and pull.frame == HAND
        np.testing.assert_allclose(pull.point, points[k + 1], atol=1e-12)
        np.testing.assert_allclose(pull.force, STIFFNESS * (target - points[k + 1]), atol=1e-9)
    assert not any(push.any() for _, push, _ in viewer.seen)  # a pull is not shown twice
    still, pulled_to, back = (points[k] - points[0] for k in (10, 199, 699))
    assert pulled_to @ [0.05, 0.0, 0.02] > 0.05 * 2e-3  # some mm along the pull
    assert np.linalg.norm(still) < 1e-4
    assert np.linalg.norm(back) < 0.3 * np.linalg.norm(pulled_to)


def test_the_physics_feels_a_pull_as_it_is_told(tmp_path: Path) -> None:
    """Against the file's push of the same force on the same point; a pull's changes little here.

    A soft spring to a far point pulls with a force that is nearly constant.
    """
    one = simulated_problem(tmp_path, "{duration: 0.1}")
    robot, force = one.parts.robot, np.array([0.0, 3.0, 1.0])
    far = placed(robot, one.parts.start) + 1e4 * force
    viewer = Watched()
    viewer.asks[10] = PullRobot(HAND, POINT, far, 1e-4)
    SimulatedSession(one, viewer, Clock(0.0)).run(50)  # type: ignore[arg-type]
    where = f"body: {HAND}, point: {POINT.tolist()}"
    push = f"{{{where}, force: {force.tolist()}, at: 0.02, duration: 1.0}}"
    same = simulated_problem(tmp_path, f"{{duration: 0.1, pushes: [{push}]}}").simulate()
    found, expected = np.array([q for q, *_ in viewer.seen]), same.run.history.q
    assert np.abs(expected - expected[0]).max() > 1e-2
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected - expected[0]).max())


def test_a_pull_is_at_most_the_weight(robot: Robot) -> None:
    now = robot.snapshot(robot.posture("standing"))
    way = np.array([0.6, 0.0, 0.8])
    wanted = PullRobot("base", np.zeros(3), now.position("base") + 100.0 * way, 1e3)
    np.testing.assert_allclose(pull_force(wanted, now).force, 9.81 * robot.mass * way, rtol=1e-9)


@pytest.fixture
def grabbable(stages: Callable[..., Stage]) -> Stage:
    return stages(push=2.0)


def tell_drag(
    client: ClientConnection, phase: str, shape: str, grabbed: np.ndarray, pointer: np.ndarray
) -> None:
    """Drag a shape with Shift, as the page's JavaScript tells it."""
    given = {"phase": phase, "name": shape, "instance_index": None, "owner": ""}
    given |= {"start_position": grabbed.tolist(), "end_position": pointer.tolist()}
    given |= dict.fromkeys(("start_screen_pos", "end_screen_pos"), (0.5, 0.5))
    tell(client, "SceneNodeDragMessage", **given, button="left", modifier="shift")


@pytest.mark.parametrize("far", [0.0, 3.0])
def test_a_part_of_the_robot_is_grabbed_dragged_and_let_go(grabbable, robot, far: float) -> None:
    q = robot.integrate(robot.posture("standing"), np.full(robot.nv, 0.1), 1.0)
    q[0] += far
    grabbable.draw(Frame(0.0, q, np.zeros(robot.nv)))
    drawn = np.asarray(grabbable.handle("").position)  # at the page's origin plus this
    assert np.linalg.norm(drawn) > 0.9 * far
    shape = shape_of(grabbable, HAND)
    rotations, origins = robot.snapshot(q).joint_placements
    joint = int(shape.split("/")[3])
    grabbed = origins[joint] + rotations[joint] @ [0.01, 0.02, 0.03]
    pointer = grabbed + [0.1, 0.2, 0.3]
    with client_of(grabbable.url) as client:
        tell_drag(client, "start", shape, grabbed + drawn, grabbed + drawn)
        tell_drag(client, "update", shape, grabbed + drawn, pointer + drawn)
        tell_drag(client, "end", shape, grabbed + drawn, pointer + drawn)
        first, second, last = received(grabbable, 3)
    assert isinstance(first, PullRobot) and isinstance(second, PullRobot)
    assert last == ReleasePull()
    now = robot.snapshot(q)
    at = now.position(second.frame) + now.rotation(second.frame) @ second.point
    np.testing.assert_allclose(at, grabbed, atol=1e-9)
    np.testing.assert_allclose(pull_force(first, now).force, 0.0, atol=1e-9)
    np.testing.assert_allclose(second.target, pointer)
    soft = second._replace(stiffness=0.1 * second.stiffness)
    grabbable.draw(Frame(0.1, q, np.zeros(robot.nv), pull=pull_force(soft, now)))
    arrow = grabbable.handle("/pull/arrow")
    assert arrow.visible
    np.testing.assert_allclose(arrow.points[0, 0], grabbed, atol=1e-5)  # single precision
    np.testing.assert_allclose(arrow.points[0, 1], grabbed + [0.01, 0.02, 0.03], atol=1e-5)
    newtons = 0.1 * second.stiffness * np.sqrt(0.14)
    assert f"{newtons:.3g} N at {second.frame}" in grabbable.page._panel._html.content
    grabbable.draw(Frame(0.2, q, np.zeros(robot.nv)))
    assert not arrow.visible


def test_a_pointer_that_rests_goes_with_the_view(grabbable: Stage, robot: Robot) -> None:
    """Even where the arrow is not shown; and once it is let go, no more."""
    q, v = robot.posture("standing"), np.zeros(robot.nv)
    grabbable.handle("/pull").visible = False
    grabbable.draw(Frame(0.0, q, v))
    pointer = robot.snapshot(q).com + [0.1, 0.0, 0.2]
    shape = shape_of(grabbable, HAND)
    with client_of(grabbable.url) as client:
        tell_drag(client, "start", shape, pointer, pointer)
        (first,) = received(grabbable, 1)
        q[0] += 3.0
        grabbable.draw(Frame(0.1, q, v))
        (second,) = received(grabbable, 1)
        grabbable.draw(Frame(0.1, q, v))  # nothing has moved
        drawn = np.asarray(grabbable.handle("").position)
        tell_drag(client, "end", shape, pointer, pointer)
        assert received(grabbable, 1) == [ReleasePull()]
    assert isinstance(first, PullRobot) and isinstance(second, PullRobot)
    assert drawn[0] < -0.5
    np.testing.assert_allclose(first.target, pointer)
    np.testing.assert_allclose(second.target, pointer - drawn)
    np.testing.assert_array_equal(second.point, first.point)
    q[0] += 3.0
    grabbable.draw(Frame(0.2, q, v))
    assert not grabbable.pipe.poll(0.2)


def test_who_leaves_the_page_lets_go(grabbable: Stage, robot: Robot) -> None:
    grabbable.draw(Frame(0.0, robot.posture("standing"), np.zeros(robot.nv)))
    with client_of(grabbable.url) as client:
        tell_drag(client, "start", shape_of(grabbable, HAND), np.zeros(3), np.zeros(3))
        assert isinstance(*received(grabbable, 1), PullRobot)
    assert received(grabbable, 1) == [ReleasePull()]


def shape_of(stage: Stage, link: str) -> str:
    """Return the path of a shape of a link."""
    nodes = stage.server.scene._handle_from_node_name
    return next(str(one) for one in nodes if one.endswith(f" {link}"))


def received(stage: Stage, count: int) -> list[object]:
    """Return so many messages that the page has sent."""
    found: list[object] = []
    for _ in range(count):
        assert stage.pipe.poll(20.0)
        found.append(stage.pipe.recv())
    return found
