"""The loop of a robot in a real browser: what its log says is on the page."""

import socket
from functools import partial
from typing import Any

import numpy as np
import pytest

import wbc
from tests.needs import needs_browser
from tests.view.live.browsing import PATIENCE, SIZE, picture
from wbc.hardware.log_row import FAULTS, MODES, log_fields
from wbc.hardware.ring_log import RingLog, Watcher
from wbc.hardware.safety import Fault, Mode
from wbc.hardware.worker import can_fork
from wbc.view.live.hardware import watch_loop

pytestmark = [
    needs_browser,
    pytest.mark.slow,
    pytest.mark.skipif(not can_fork(), reason="the log has no process of its own here"),
]


def test_estimate_mode_and_faults_are_shown(browser: Any, robot: wbc.Robot) -> None:
    ring = RingLog(log_fields(len(robot.joint_names), robot.nq, robot.nv), 1.0, 0.002)
    row = {"time": 12.5, "lateness": 4e-5, "answer_time": 5e-4, "mode": MODES.index(Mode.RUNNING)}
    row |= {"faults": 1 << FAULTS.index(Fault.SILENT), "deviations": (0.001, 0.2, 0.005, 0.03)}
    row |= {"q": robot.posture("standing"), "v": np.zeros(robot.nv)}
    ring.add({**row, "standing": 1 << tuple(robot.feet).index("left")})
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    watcher = Watcher(ring, partial(watch_loop, robot, port=port))
    try:
        page = browser.new_page(viewport=SIZE)
        page.set_default_timeout(1e3 * PATIENCE)
        for _ in range(60):
            try:
                page.goto(f"http://localhost:{port}")
                break
            except Exception:  # it is not served yet
                page.wait_for_timeout(1000.0)
        page.get_by_text("standing on: left").first.wait_for()
        told = page.locator("body").inner_text()
        picture(page, "hardware")
    finally:
        watcher.close()
    assert str(Mode.RUNNING) in told and f"faults: {Fault.SILENT}" in told
    assert "estimate +-30.0 mm, 5.0 mm/s, tilt 0.06, heading 11.46 degrees" in told
