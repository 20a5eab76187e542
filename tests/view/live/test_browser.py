"""Pages in a real browser: of problems, of robots far away, and of simulations.

Slow, and it needs Playwright and a Chromium: run it with WBC_BROWSER=/usr/bin/chromium.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import wbc
from tests.needs import needs_browser
from tests.texts import STAND
from tests.view.live.browsing import (
    PATIENCE,
    Live,
    drag_mouse,
    enter,
    on_screen,
    opened,
    picture,
    scrub,
    time_on,
    typed,
)
from tests.view.live.conftest import client_of
from wbc.view.live.messages import PullRobot, ReleasePull
from wbc.view.live.viewer import Viewer

pytestmark = [needs_browser, pytest.mark.slow]

PROBLEM = """
robot: hoap2_like
start: {posture: standing}
support: double
tasks:
  shape: {type: inertia, components: [xx, yy, zz], target: start, per_mass: true, weight: 10.0}
  com: {type: com, target: start, axes: [x, y], weight: 10.0}
  hand: {type: frame, frame: left_hand, control: position, target: start, weight: 1.0}
  posture: {type: posture, target: start, weight: 0.01}
constraints:
  bodies: {type: self_collision, margin: 0.005}
"""
FAR = np.array([3.0, -2.0, 0.0])


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    made = Live(tmp_path_factory.mktemp("live") / "browser.yaml", PROBLEM)
    yield made
    made.close()


@pytest.fixture(scope="module")
def page(browser: Any, live: Live) -> Any:
    return opened(browser, live)


def test_the_page_loads_and_time_goes_on(page: Any, live: Live) -> None:
    first = time_on(page)
    page.wait_for_timeout(3000.0)
    assert time_on(page) > first + 0.5
    picture(page, "loaded")


def test_a_slider_changes_the_ellipsoid_and_the_joints_follow(page: Any, live: Live) -> None:
    page.get_by_role("tab", name="Steer").click()
    before = live.now.inertia[2, 2]
    enter(page, "zz times", 1.2)
    assert live.becomes(lambda: live.task("shape").target[5] > 1.15 * live.start.inertia[2, 2])
    assert live.becomes(lambda: live.now.inertia[2, 2] > 1.1 * before)
    joints = np.abs(live.now.joint_positions - live.start.joint_positions).max()
    assert joints > 0.05
    picture(page, "slider")


def test_a_dragged_target_is_followed(page: Any, live: Live) -> None:
    page.get_by_role("tab", name="Run").click()
    target = live.task("hand").target.copy()
    x, y = on_screen(live, target + [0.0, 0.0, 0.07])  # the arrow that points up
    drag_mouse(page, x, y, up=48.0)
    picture(page, "drag")
    page.mouse.up()
    assert live.becomes(lambda: live.task("hand").target[2] > target[2] + 0.02)
    wanted = live.task("hand").target
    assert live.becomes(lambda: bool(np.abs(live.now.position("left_hand") - wanted).max() < 0.01))


def test_going_back_and_to_now(page: Any, live: Live) -> None:
    ticks = live.session.ticks
    now = time_on(page)
    scrub(page, 0.1)  # the slider ends a third beyond the newest frame
    page.get_by_text("Back to now").wait_for()
    assert live.becomes(lambda: time_on(page) < 0.3 * now)
    assert live.becomes(lambda: abs(typed(page, "Time [s]") - time_on(page)) < 0.1)
    assert live.becomes(lambda: live.session.ticks > ticks + 100)  # the loop goes on
    picture(page, "back")
    page.get_by_text("Back to now").click()
    assert live.becomes(lambda: time_on(page) > now)


def test_pause_step_and_play(page: Any, live: Live) -> None:
    page.get_by_text("Pause", exact=True).click()
    assert live.becomes(lambda: not live.session.clock.playing)
    page.wait_for_timeout(500.0)
    ticks = live.session.ticks
    page.get_by_text("Step", exact=True).click()
    assert live.becomes(lambda: live.session.ticks == ticks + 1)
    page.get_by_text("(paused)").wait_for()
    page.get_by_text("Play", exact=True).click()
    assert live.becomes(lambda: live.session.ticks > ticks + 20)


def test_reload_and_a_second_client(page: Any, live: Live) -> None:
    page.reload()
    page.get_by_text("left_sole, right_sole").first.wait_for()
    with client_of(live.viewer.url) as other:
        ticks = live.session.ticks
        assert other.recv(timeout=PATIENCE)  # is told what there is to see
        assert live.becomes(lambda: live.session.ticks > ticks + 100)
        before = time_on(page)
        assert live.becomes(lambda: time_on(page) > before)
    assert live.becomes(lambda: time_on(page) > before + 0.1)
    assert not live.viewer.error


@pytest.fixture
def simulated(tmp_path: Path) -> Iterator[Live]:
    made = Live(tmp_path / "simulated.yaml", STAND)
    yield made
    made.close()


def test_a_push_by_button_and_a_pull_by_drag(browser: Any, simulated: Live) -> None:
    live = simulated
    page = opened(browser, live)
    page.get_by_role("button", name="Push", exact=True).click()
    assert live.becomes(lambda: live.pushed)
    assert live.becomes(lambda: bool(not live.push.any()))
    live.becomes(lambda: bool(np.abs(live.now.v).max() < 0.02))
    before = live.now.com
    x, y = on_screen(live, live.now.position("base"))
    page.keyboard.down("Shift")
    drag_mouse(page, x, y, right=40.0)
    assert live.becomes(lambda: live.pull is not None)
    assert live.becomes(lambda: bool(np.linalg.norm(live.now.com - before) > 1e-3))
    page.get_by_text(re.compile(r"\d N at ")).wait_for()
    picture(page, "pull")
    assert live.pull is not None
    assert (live.now.com - before) @ live.pull.force > 0.0
    page.mouse.up()
    page.keyboard.up("Shift")
    assert live.becomes(lambda: live.pull is None)
    assert live.becomes(lambda: bool(np.linalg.norm(live.now.com - before) < 1e-3))
    assert not live.viewer.error
    page.close()


@pytest.fixture
def far(robot: wbc.Robot) -> Iterator[Any]:
    """A viewer that shows a robot which stands far from the world's origin."""
    q = robot.posture("standing")
    q[:3] += FAR
    now = robot.snapshot(q)
    hand = wbc.PositionTask(robot, "left_hand", now.position("left_hand"), name="hand")
    controller = wbc.KinematicController(robot, [hand], contacts=wbc.support(now, "double"))
    with Viewer(robot, controller, clock=True, push=2.0, quiet=True) as viewer:
        viewer.update(now, controller.step(now))
        yield SimpleNamespace(viewer=viewer, now=now, hand=hand)


def test_it_is_grabbed_and_its_targets_are_dragged_in_the_world(browser: Any, far: Any) -> None:
    viewer, now = far.viewer, far.now
    page = opened(browser, far)
    followed = np.array([*now.com[:2], 0.0])

    x, y = on_screen(far, now.position("base") - followed)
    page.keyboard.down("Shift")
    drag_mouse(page, x, y, right=40.0)
    picture(page, "grabbed far away")
    page.mouse.up()
    page.keyboard.up("Shift")
    found = requests(page, viewer)
    pulls = [one for one in found if isinstance(one, PullRobot)]
    assert isinstance(found[-1], ReleasePull) and len(pulls) > 1
    grabbed = now.position(pulls[-1].frame) + now.rotation(pulls[-1].frame) @ pulls[-1].point
    assert np.linalg.norm(grabbed - now.position("base")) < 0.15
    np.testing.assert_allclose(pulls[0].target, grabbed, atol=0.02)
    moved = pulls[-1].target - grabbed
    assert 0.01 < np.linalg.norm(moved) < 0.3
    ahead = np.array(on_screen(far, grabbed + moved - followed)) - (x, y)
    np.testing.assert_allclose(ahead, (40.0, 0.0), atol=3.0)

    target = far.hand.target.copy()
    x, y = on_screen(far, target + [0.0, 0.0, 0.07] - followed)  # the arrow that points up
    drag_mouse(page, x, y, up=48.0)
    picture(page, "dragged far away")
    page.mouse.up()
    page.wait_for_timeout(2000.0)
    viewer.steer()
    up = far.hand.target - target
    np.testing.assert_allclose(up[:2], 0.0, atol=1e-3)
    assert 0.02 < up[2] < 0.3
    assert not viewer.error
    page.close()


def requests(page: Any, viewer: Viewer) -> list[Any]:
    """Return what the page asks for until the robot is let go."""
    found = list[Any]()
    for _ in range(round(PATIENCE / 0.1)):
        while (request := viewer.next_request()) is not None:
            found.append(request)
        if any(isinstance(one, ReleasePull) for one in found):
            break
        page.wait_for_timeout(100.0)
    return found
