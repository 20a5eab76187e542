"""A session in a thread, and its page in a real browser: Chromium, drawing by software."""

import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from wbc.problem import load_problem
from wbc.robot import Snapshot
from wbc.view.camera import viewing_axes
from wbc.view.live.layers.robot import RobotShapes
from wbc.view.live.messages import PullForce
from wbc.view.live.page import AZIMUTH, DISTANCE, ELEVATION
from wbc.view.live.session import Session, checked
from wbc.view.live.simulated import SimulatedSession, strongest_push
from wbc.view.live.viewer import Viewer

PICTURES = os.environ.get("WBC_BROWSER_PICTURES", "")  # a folder to leave screenshots in

PATIENCE = 180.0  # s for anything to happen: software draws a frame in seconds
SIZE = {"width": 1000, "height": 700}
FINENESS = 0.4  # pixels drawn by one of the page's: software fills each of them


class Live:
    """A session in a thread, and what it has last shown."""

    def __init__(self, file: Path, text: str) -> None:
        file.write_text(text)
        problem = checked(load_problem(file))
        simulated = problem.spec.controller.level == "torque"
        push = strongest_push(problem) if simulated else 0.0
        robot = problem.parts.robot
        self.viewer = Viewer(robot, title="browser", clock=True, push=push, quiet=True)
        self.start = problem.parts.robot.snapshot(problem.parts.start)
        self.now: Snapshot = self.start
        self.pull: PullForce | None = None
        self.push = np.zeros(3)
        self.pushed = False  # at any time: a push is over in three frames
        self.changed = threading.Condition()
        update = self.viewer.update

        def remember(snapshot: Snapshot, *rest: Any, **more: Any) -> None:
            update(snapshot, *rest, **more)
            with self.changed:
                self.now, self.pull = snapshot, more["pull"]
                self.push = np.zeros(3) if more["push"] is None else more["push"]
                self.pushed |= bool(self.push.any())
                self.changed.notify()

        self.viewer.update = remember  # type: ignore[method-assign]
        self.session = (SimulatedSession if simulated else Session)(problem, self.viewer)
        self.thread = threading.Thread(target=self.session.run, daemon=True)
        self.thread.start()

    def becomes(self, condition: Callable[[], bool]) -> bool:
        """Wait until something is so; looked at whenever the session has shown something."""
        with self.changed:
            return self.changed.wait_for(condition, PATIENCE)

    def close(self) -> None:
        self.viewer.close()
        self.thread.join(PATIENCE)

    def task(self, name: str) -> Any:
        assert self.viewer.controller is not None
        return next(one for one in self.viewer.controller.tasks if one.name == name)


def opened(browser: Any, live: Live) -> Any:
    """Open the page, and wait until it shows the robot."""
    page = browser.new_page(viewport=SIZE, device_scale_factor=FINENESS)
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
    box = box_of(page, label)
    box.fill(f"{value:g}")
    box.press("Enter")
    box.blur()


def typed(page: Any, label: str) -> float:
    """Return the value in the box of a slider."""
    return float(box_of(page, label).input_value())


def box_of(page: Any, label: str) -> Any:
    """Return the box of a slider."""
    row = page.locator(f"label:text-is('{label}')").locator("xpath=ancestor::*[.//input][1]")
    return row.locator("input[type=text], input[inputmode]").last


def scrub(page: Any, part: float) -> None:
    """Click on the slider through time, at a part of its length."""
    row = page.locator("label:text-is('Time [s]')").locator("xpath=ancestor::*[.//input][1]")
    box = row.locator(".mantine-Slider-trackContainer").bounding_box()
    page.mouse.click(box["x"] + part * box["width"], box["y"] + 0.5 * box["height"])


def drag_mouse(page: Any, x: float, y: float, right: float = 0.0, up: float = 0.0) -> None:
    """Press at a pixel and go on by so many, slowly; the button stays down."""
    page.mouse.move(x, y)
    page.wait_for_timeout(1500.0)
    page.mouse.down()
    for k in range(1, 9):
        page.mouse.move(x + right * k / 8.0, y - up * k / 8.0)
        page.wait_for_timeout(300.0)


def picture(page: Any, name: str) -> None:
    if PICTURES:
        page.screenshot(path=f"{PICTURES}/{name}.png")


def on_screen(live: Live, point: np.ndarray) -> tuple[float, float]:
    """Return the pixel at which the page's first camera sees a point (3,)."""
    robot = live.viewer.robot
    low, high = RobotShapes(robot).extent(robot, robot.posture())
    centre, size = 0.5 * (low + high), float(np.max(high - low))
    right, down, forward = viewing_axes(AZIMUTH, ELEVATION)
    ahead = point - (centre - DISTANCE * size * forward)
    focal = 0.5 * SIZE["height"] / np.tan(0.5 * np.deg2rad(75.0))
    depth = ahead @ forward
    return (
        0.5 * SIZE["width"] + focal * float(ahead @ right) / depth,
        0.5 * SIZE["height"] + focal * float(ahead @ down) / depth,
    )
