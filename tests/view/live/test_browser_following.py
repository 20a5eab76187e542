"""A robot far away in a real browser: seen, grabbed and steered there; see test_browser.py."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import wbc
from tests.needs import needs_browser
from tests.view.live.browsing import PATIENCE, drag_mouse, on_screen, opened, picture
from wbc.view.live.messages import PullRobot, ReleasePull
from wbc.view.live.viewer import Viewer

pytestmark = [needs_browser, pytest.mark.slow]

FAR = np.array([3.0, -2.0, 0.0])


@pytest.fixture
def live(robot: wbc.Robot) -> Iterator[Any]:
    """A viewer that shows a robot which stands far from the world's origin."""
    q = robot.posture("standing")
    q[:3] += FAR
    now = robot.snapshot(q)
    hand = wbc.PositionTask(robot, "left_hand", now.position("left_hand"), name="hand")
    controller = wbc.KinematicController(robot, [hand], contacts=wbc.support(now, "double"))
    with Viewer(robot, controller, clock=True, push=2.0, quiet=True) as viewer:
        viewer.update(now, controller.step(now))
        yield SimpleNamespace(viewer=viewer, now=now, hand=hand)


def test_it_is_grabbed_and_its_targets_are_dragged_in_the_world(browser: Any, live: Any) -> None:
    viewer, now = live.viewer, live.now
    page = opened(browser, live)
    followed = np.array([*now.com[:2], 0.0])

    x, y = on_screen(live, now.position("base") - followed)
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
    ahead = np.array(on_screen(live, grabbed + moved - followed)) - (x, y)
    np.testing.assert_allclose(ahead, (40.0, 0.0), atol=3.0)

    target = live.hand.target.copy()
    x, y = on_screen(live, target + [0.0, 0.0, 0.07] - followed)  # the arrow that points up
    drag_mouse(page, x, y, up=48.0)
    picture(page, "dragged far away")
    page.mouse.up()
    page.wait_for_timeout(2000.0)
    viewer.steer()
    up = live.hand.target - target
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
