"""The page of a simulation in a real browser; see test_browser.py."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.needs import needs_browser
from tests.texts import STAND
from tests.view.live.browsing import Live, drag_mouse, on_screen, opened, picture

pytestmark = [needs_browser, pytest.mark.slow]


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
