"""The page of a kinematic problem in a real browser.

Slow, and it needs Playwright and a Chromium: run it with WBC_BROWSER=/usr/bin/chromium.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tests.needs import needs_browser
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
