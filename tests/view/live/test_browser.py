"""The page in a real browser: Chromium, headless, drawing by software.

Slow, and it needs Playwright and a Chromium: run it with WBC_BROWSER=/usr/bin/chromium.
"""

import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wbc.problem import load_problem
from wbc.robot import Snapshot
from wbc.view.live.session import Session, checked
from wbc.view.live.viewer import Viewer

BROWSER = os.environ.get("WBC_BROWSER", "")
PICTURES = os.environ.get("WBC_BROWSER_PICTURES", "")  # a folder to leave screenshots in
pytestmark = pytest.mark.skipif(not BROWSER, reason="WBC_BROWSER names no Chromium")

PATIENCE = 180.0  # s for anything to happen: software draws a frame in seconds
SOFTWARE = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
)
SIZE = {"width": 1000, "height": 700}
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


class Live:
    """A session in a thread, and what it has last shown."""

    def __init__(self, file: Path) -> None:
        file.write_text(PROBLEM)
        problem = checked(load_problem(file))
        self.viewer = Viewer(problem.parts.robot, title="browser", clock=True, quiet=True)
        self.start = problem.parts.robot.snapshot(problem.parts.start)
        self.now: Snapshot = self.start
        self.changed = threading.Condition()
        update = self.viewer.update

        def remember(snapshot: Snapshot, *rest: Any, **more: Any) -> None:
            update(snapshot, *rest, **more)
            with self.changed:
                self.now = snapshot
                self.changed.notify()

        self.viewer.update = remember  # type: ignore[method-assign]
        self.session = Session(problem, self.viewer)
        self.thread = threading.Thread(target=self.session.run, daemon=True)
        self.thread.start()

    def becomes(self, condition: Callable[[], bool]) -> bool:
        """Wait until something is so; looked at whenever the session has shown something."""
        with self.changed:
            return self.changed.wait_for(condition, PATIENCE)

    def task(self, name: str) -> Any:
        assert self.viewer.controller is not None
        return next(one for one in self.viewer.controller.tasks if one.name == name)


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    made = Live(tmp_path_factory.mktemp("live") / "browser.yaml")
    yield made
    made.viewer.close()
    made.thread.join(PATIENCE)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as started:
        opened = started.chromium.launch(executable_path=BROWSER, args=list(SOFTWARE))
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def page(browser: Any, live: Live) -> Any:
    return opened(browser, live)


def opened(browser: Any, live: Live) -> Any:
    """Open the page, and wait until it shows the robot."""
    page = browser.new_page(viewport=SIZE)
    page.set_default_timeout(1e3 * PATIENCE)
    page.goto(live.viewer.url)
    page.get_by_text("left_sole, right_sole").first.wait_for()
    page.wait_for_timeout(3000.0)
    warning = page.locator(".mantine-Notification-closeButton")  # of drawing by software
    if warning.count():
        warning.first.click()
    return page


def time_on(page: Any) -> float:
    """Return the time that the panel shows [s]."""
    line = page.locator("div:has(> span:text-is('time')) > span").nth(1)
    return float(line.inner_text().split()[0])


def enter(page: Any, label: str, value: float) -> None:
    """Type a value into the box of a slider."""
    row = page.locator(f"label:text-is('{label}')").locator("xpath=ancestor::*[.//input][1]")
    box = row.locator("input[type=text], input[inputmode]").last
    box.fill(f"{value:g}")
    box.press("Enter")
    box.blur()


def picture(page: Any, name: str) -> None:
    if PICTURES:
        page.screenshot(path=f"{PICTURES}/{name}.png")


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
    page.mouse.move(x, y)
    page.wait_for_timeout(1500.0)
    page.mouse.down()
    for k in range(1, 9):
        page.mouse.move(x, y - 6.0 * k)
        page.wait_for_timeout(300.0)
    picture(page, "drag")
    page.mouse.up()
    assert live.becomes(lambda: live.task("hand").target[2] > target[2] + 0.02)
    wanted = live.task("hand").target
    assert live.becomes(lambda: bool(np.abs(live.now.position("left_hand") - wanted).max() < 0.01))


def test_going_back_and_to_now(page: Any, live: Live) -> None:
    ticks = live.session.ticks
    enter(page, "Time [s]", 0.5)
    page.get_by_text("Back to now").wait_for()
    assert live.becomes(lambda: time_on(page) < 1.0)
    assert live.becomes(lambda: live.session.ticks > ticks + 100)  # the loop goes on
    picture(page, "back")
    page.get_by_text("Back to now").click()
    assert live.becomes(lambda: time_on(page) > 1.0)


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


def test_reload_and_two_browsers(page: Any, live: Live, browser: Any) -> None:
    ticks = live.session.ticks
    page.reload()
    page.get_by_text("left_sole, right_sole").first.wait_for()
    other = opened(browser, live)
    assert abs(time_on(other) - time_on(page)) < 30.0
    other.close()
    assert live.becomes(lambda: live.session.ticks > ticks + 100)
    before = time_on(page)
    assert live.becomes(lambda: time_on(page) > before)
    assert not live.viewer.error


def on_screen(live: Live, point: np.ndarray) -> tuple[float, float]:
    """Return the pixel at which the page's first camera sees a point (3,)."""
    from wbc.view.live.layers.robot import RobotShapes
    from wbc.view.live.page import AZIMUTH, DISTANCE, ELEVATION

    robot = live.viewer.robot
    low, high = RobotShapes(robot).extent(robot, robot.posture())
    centre, size = 0.5 * (low + high), float(np.max(high - low))
    way = np.array(
        [
            np.cos(ELEVATION) * np.cos(AZIMUTH),
            np.cos(ELEVATION) * np.sin(AZIMUTH),
            np.sin(ELEVATION),
        ]
    )
    forward, up = -way, np.array([0.0, 0.0, 1.0])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    ahead = point - (centre + DISTANCE * size * way)
    focal = 0.5 * SIZE["height"] / np.tan(0.5 * np.deg2rad(75.0))
    depth = ahead @ forward
    return (
        0.5 * SIZE["width"] + focal * float(ahead @ right) / depth,
        0.5 * SIZE["height"] + focal * float(ahead @ down) / depth,
    )
