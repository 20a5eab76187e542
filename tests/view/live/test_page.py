"""The page without a browser: its scene, panel, recording, title; foreign pages are refused."""

import gzip
import threading
from dataclasses import replace
from urllib.request import Request, urlopen

import numpy as np
import pytest
from websockets.datastructures import Headers
from websockets.exceptions import InvalidStatus

import wbc
from tests.urdf import stone
from tests.view.live.conftest import Stage, client_of, frame_at, rotation_of, tell
from wbc.human import HumanBody, human_robot
from wbc.rmp.ellipsoid import equimomental
from wbc.view.live.collect import tick_info
from wbc.view.live.controls import Recording
from wbc.view.live.messages import Frame
from wbc.view.live.process import HOST, page_address
from wbc.view.live.server import Server, refusal


@pytest.fixture(scope="module")
def controller(robot: wbc.Robot) -> wbc.KinematicController:
    start = robot.snapshot(robot.posture("standing"))
    com = wbc.ComTask(robot, start.com + [0.0, 0.02, 0.0], weight=10.0)
    tasks = [com, wbc.InertiaTask(robot, 1.2 * start.inertia, per_mass=True)]
    given = {"contacts": wbc.support(start, "double"), "limits": wbc.Limits(robot)}
    return wbc.KinematicController(robot, tasks, **given)


def test_links_and_ellipsoid_are_where_the_robot_is(stage, controller) -> None:
    robot = controller.robot
    rng = np.random.default_rng(0)
    q = robot.integrate(robot.posture("standing"), 0.2 * rng.normal(size=robot.nv), 1.0)
    snapshot = stage.show(controller, q)
    stage.check_placed("robot", snapshot)
    ball = stage.handle("/ellipsoid/surface")
    ellipsoid = equimomental(snapshot.inertia, robot.mass)
    np.testing.assert_allclose(ball.scale, ellipsoid.semi_axes, atol=1e-9)
    np.testing.assert_allclose(ball.position, snapshot.com, atol=1e-9)
    stretched = rotation_of(ball) @ np.diag(np.square(ball.scale)) @ rotation_of(ball).T
    wanted = ellipsoid.axes @ np.diag(ellipsoid.semi_axes**2) @ ellipsoid.axes.T
    np.testing.assert_allclose(stretched, wanted, atol=1e-9)


def test_a_human_is_beside_the_robot(stages, controller) -> None:
    human, rng = human_robot(HumanBody.of(1.75, 70.0, "male")), np.random.default_rng(1)
    stage = stages(beside=human)
    q = human.integrate(human.posture("neutral"), 0.3 * rng.normal(size=human.nv), 1.0)
    frame = frame_at(controller, controller.robot.posture("standing"), 0.0)
    stage.draw(replace(frame, beside=q))
    stage.check_placed("human", human.snapshot(q))


def test_six_masses_have_the_inertia_of_the_robot(stage, controller) -> None:
    robot, snapshot = controller.robot, stage.show(controller)
    inertia = np.zeros((3, 3))
    for k in range(3):
        for sign in ("-1", "+1"):
            r = stage.handle(f"/reaction_masses/{k} {sign}").position - snapshot.com
            inertia += robot.mass / 6.0 * (r @ r * np.eye(3) - np.outer(r, r))
    np.testing.assert_allclose(inertia, snapshot.inertia, rtol=1e-6, atol=1e-9)


def test_a_layer_that_is_hidden_is_drawn_when_it_is_shown(stage, controller) -> None:
    moved = stage.show(controller).q + np.eye(controller.robot.nq)[0]
    there = stage.handle("/ellipsoid/surface").position.copy()
    stage.handle("/ellipsoid").visible = False
    stage.draw(frame_at(controller, moved, 0.1))
    np.testing.assert_array_equal(stage.handle("/ellipsoid/surface").position, there)
    stage.handle("/ellipsoid").visible = True
    stage.page._changed = True
    stage.draw()
    now = stage.handle("/ellipsoid/surface").position
    np.testing.assert_allclose(now, there + [1.0, 0.0, 0.0], atol=1e-9)


def test_going_back_in_time(stage: Stage, controller: wbc.KinematicController) -> None:
    robot = controller.robot
    q = robot.posture("standing")
    heights = []
    for k in range(5):
        moved = q + 0.1 * k * np.eye(robot.nq)[2]
        heights.append(robot.snapshot(moved).com[2])
        stage.draw(frame_at(controller, moved, 0.1 * k))
    ball = stage.handle("/com/com")
    assert ball.position[2] == pytest.approx(heights[4])
    stage.page._controls.past = 0.15
    stage.draw()
    assert ball.position[2] == pytest.approx(heights[1])
    stage.draw(frame_at(controller, q, 0.5))  # the loop goes on, the view stays
    assert ball.position[2] == pytest.approx(heights[1])
    stage.page._controls.past = None
    stage.draw()
    assert ball.position[2] == pytest.approx(heights[0])


def test_where_the_user_puts_the_slider_is_kept_while_others_are_answered(
    stage: Stage, controller: wbc.KinematicController
) -> None:
    q, free, moved = controller.robot.posture("standing"), threading.Event(), threading.Event()
    busy = stage.server.gui.add_button("busy")
    busy.on_click(lambda _: free.wait(30.0))
    with client_of(stage.url) as client:
        for k in range(5):
            stage.draw(frame_at(controller, q, float(k)))
        for _ in range(40):  # more than are answered at once
            tell(client, "GuiUpdateMessage", uuid=busy._impl.uuid, updates={"value": True})

        async def seen(_: object) -> None:  # after the page's own
            moved.set()

        stage.gui("Time [s]").on_update(seen)
        stage.move_slider(client, "Time [s]", 1.5)
        assert moved.wait(60.0)
        stage.draw(frame_at(controller, q, 5.0))  # the loop goes on, and so does the slider
        free.set()
    assert stage.page._controls.past == 1.5


def test_a_floating_robot_has_no_leg(stage: Stage, robot: wbc.Robot) -> None:
    start = robot.snapshot(robot.posture("standing"))
    floating = wbc.KinematicController(robot, [wbc.InertiaTask(robot, start.inertia)])
    standing = wbc.KinematicController(robot, floating.tasks, contacts=wbc.support(start, "double"))
    stage.show(standing)
    names = ("/leg_cop_cmp/leg", "/leg_cop_cmp/cop", "/com/plumb", "/soles_and_support/polygon")
    assert all(stage.handle(name).visible for name in names)
    stage.show(floating, time=0.1)
    assert not any(stage.handle(name).visible for name in names)


def test_the_panel_names_what_holds_back(stage: Stage, robot: wbc.Robot) -> None:
    q = robot.posture("standing")
    start = robot.snapshot(q)
    # Out of reach: joints run into their limits.
    wide = wbc.InertiaTask(robot, 3.0 * start.inertia, name="a <wide> one")
    base = wbc.PoseTask(robot, "base", start.position("base"), start.rotation("base"), weight=0.1)
    controller = wbc.KinematicController(robot, [wide, base], limits=wbc.Limits(robot))
    at_limit = ""
    for _ in range(400):
        tick = controller.step(robot.snapshot(q))
        q = robot.integrate(q, tick.velocity, controller.dt)
        at_limit = next(iter(tick_info(tick).at_limit), "")
        if at_limit:
            break
    joint, side = at_limit.rsplit(" ", 1)
    bound = tick.qp.upper if side == "upper" else tick.qp.lower
    at = tick.qp.labels.variables.index(joint)
    assert tick.velocity[at] == pytest.approx(bound[at], abs=1e-5)
    stage.show(controller, q)
    text = stage.page._panel._html.content
    assert "a &lt;wide&gt; one" in text
    assert "<wide>" not in text
    off = base.residual(robot.snapshot(q)).error  # of positions and rotations
    assert f"{np.linalg.norm(off):.3g} m, rad" in text


def test_nobody_can_ask_for_a_tunnel(stage: Stage) -> None:
    assert stage.server.request_share_url() is None


def test_a_robot_without_shapes_is_seen_by_its_ellipsoid() -> None:
    body = wbc.Robot.load(stone(mass=2, moment=1))
    stage = Stage(body)
    controller = wbc.KinematicController(body, [wbc.ComTask(body, np.zeros(3))], dt=0.01)
    snapshot = stage.show(controller, body.posture("neutral"))  # its CoM is in the ground's plane
    stage.server.stop()
    a = np.sqrt(2.5 * 1 / 2)  # m: I = M/5 (a^2 + a^2) of a ball
    camera = stage.server.initial_camera
    np.testing.assert_allclose(camera.look_at, snapshot.com, atol=1e-9)
    assert np.linalg.norm(camera.position - camera.look_at) > 2.0 * a
    assert 0.0 < camera.near < a < camera.far
    note = stage.page._panel._note
    assert note.startswith("there are no visual shapes, and no collision shapes to draw instead: ")


def frame(time: float) -> Frame:
    return Frame(time, np.zeros(7), np.zeros(6))


def recording(times: list[float], most: int = 100) -> Recording:
    kept = Recording(most)
    for time in times:
        kept.add(frame(time), None)
    return kept


def time_at(kept: Recording, time: float) -> float:
    found = kept.at(time)
    assert found is not None
    return found[0].time


def test_the_frame_before_a_time() -> None:
    kept = recording([0.0, 0.1, 0.2, 0.3])
    assert [time_at(kept, t) for t in (-1.0, 0.0, 0.15, 0.3, 9.0)] == [0.0, 0.0, 0.1, 0.3, 0.3]
    assert kept.span == (0.0, 0.3)
    assert Recording().at(0.0) is None
    assert Recording().latest is None


def test_the_same_time_again_replaces() -> None:
    kept = recording([0.0, 0.1])
    again = frame(0.1)
    kept.add(again, None)
    assert len(kept) == 2
    assert kept.latest is not None
    assert kept.latest[0] is again


def test_a_restart_begins_anew() -> None:
    assert recording([0.0, 0.1, 0.2, 0.0]).span == (0.0, 0.0)


def test_a_long_recording_keeps_its_span_and_its_end() -> None:
    times = [0.01 * k for k in range(1000)]
    kept = recording(times, most=100)
    assert len(kept) <= 100
    assert kept.span == (0.0, times[-1])
    assert [time_at(kept, t) for t in times[-50:]] == times[-50:]


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://localhost:1"])
def test_foreign_pages_are_refused(stage: Stage, origin: str) -> None:
    with pytest.raises(InvalidStatus) as refused:
        client_of(stage.url, origin)
    assert refused.value.response.status_code == 403


def test_the_page_itself_and_programs_are_not_refused(stage: Stage) -> None:
    for origin in (stage.url, None):
        with client_of(stage.url, origin) as client:
            assert client.recv(timeout=20.0)


@pytest.mark.parametrize(
    ("host", "address", "origin", "refused"),
    [
        ("127.0.0.1", "localhost:8080", "http://localhost:8080", False),
        ("127.0.0.1", "LOCALHOST:8080", "http://localhost:8080", False),
        ("127.0.0.1", "[::1]:8080", "http://[::1]:8080", False),
        ("127.0.0.1", "localhost:8080", "https://localhost:8080.evil.example", True),
        ("127.0.0.1", "localhost:8080", "http://localhost:8081", True),
        ("127.0.0.1", "rebound.example:8080", "http://rebound.example:8080", True),
        ("127.0.0.1", "[::1", None, True),
        ("0.0.0.0", "robot.lab:8080", "http://robot.lab:8080", False),
        ("0.0.0.0", "robot.lab:8080", "http://evil.example", True),
    ],
)
def test_who_is_refused_follows_from_host_and_origin(
    host: str, address: str, origin: str | None, refused: bool
) -> None:
    headers = Headers({"Host": address})
    if origin is not None:
        headers["Origin"] = origin
    assert bool(refusal(host, headers)) == refused


def test_several_origins_are_refused() -> None:
    headers = Headers([("Host", "localhost"), ("Origin", "http://localhost"), ("Origin", "null")])
    assert refusal("127.0.0.1", headers)


def page_of(url: str, encoding: str) -> str:
    with urlopen(Request(url, headers={"Accept-Encoding": encoding})) as answer:
        body = answer.read()
        assert answer.headers.get_all("Content-Length") == [str(len(body))]
    return (gzip.decompress(body) if encoding == "gzip" else body).decode()


@pytest.mark.parametrize("encoding", ["gzip", "identity"])
def test_the_tab_names_run_robot_and_program(stage: Stage, encoding: str) -> None:
    assert f"<title>test - {stage.page._robot.name} - wbc</title>" in page_of(stage.url, encoding)


def test_a_robot_s_own_page_names_it_once_and_as_it_is() -> None:
    place = page_address(HOST, None)
    server = Server(place.host, place.port, r"<a> \1 & b", r"<a> \1 & b")
    page = page_of(f"http://{HOST}:{server.get_port()}", "gzip")
    server.stop()
    assert r"<title>&lt;a&gt; \1 &amp; b - wbc</title>" in page
