"""What must be kept all the time: a robot that falls, slips or collides is no success."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.problem.loading import problem_of
from wbc import KinematicController, Limits, PostureTask, Robot, support
from wbc.problem import Problem
from wbc.run import RunStatus, Stop, simulate

LEAN = """\
robot: hoap2_like
support: double
tasks:
  com: {type: com, target: {offset: [0.08, 0, 0]}, axes: [x, y], weight: 100, gain: 0.1}
  calm: {type: posture, weight: 0.01}
stop: {duration: 4.0, speed: 1.0e-3, accept: {com: 1.0e-3}}
"""


def problem(folder: Path, overrides: dict[str, Any] | None = None, text: str = LEAN) -> Problem:
    return problem_of(folder, text, overrides)


def test_a_robot_that_falls_over_is_no_success(tmp_path: Path) -> None:
    one = problem(tmp_path)
    result = one.run()
    # By the soles' corners, wherever they are: outside.
    end = one.parts.robot.snapshot(result.q)
    corners = [
        end.position(f"{name}_sole")[:2] + foot.polygon @ end.rotation(f"{name}_sole")[:2, :2].T
        for name, foot in one.parts.robot.feet.items()
    ]
    outside = np.concatenate(corners)[:, 0].max() - end.com[0]
    assert outside < -0.01
    assert result.status is RunStatus.NOT_KEPT
    assert not result.status.good
    assert "the robot falls: its CoM was" in result.reason
    assert result.not_kept == tuple(result.summary()["not_kept"])
    assert result.tasks["com"].norm < 1e-3  # which is all that was looked at before


@pytest.mark.parametrize(("least", "good"), [(None, True), (-0.1, True), (0.0, False)])
def test_balance_can_be_switched_off(tmp_path: Path, least: float | None, good: bool) -> None:
    assert problem(tmp_path, {"stop.balance": least}).run().status.good == good


def test_balance_can_be_asked_with_a_margin(tmp_path: Path) -> None:
    asked = {"tasks.com.target": {"offset": [0.0, 0.0, 0.0]}, "stop.balance": 0.5}
    result = problem(tmp_path, asked).run()
    assert result.status is RunStatus.NOT_KEPT
    assert "inside the soles, less than 500 mm" in result.reason


def test_a_contact_far_from_its_anchor_has_slipped(hoap2: Robot) -> None:
    """Feet that are held without taking back a drift stay where they have been pushed."""
    start = hoap2.snapshot(hoap2.posture())
    contacts = support(start, "double")
    moved = hoap2.integrate(start.q, np.r_[0.02, np.zeros(hoap2.nv - 1)], 1.0)
    tasks = [PostureTask(hoap2, start.q)]
    made = KinematicController(hoap2, tasks, contacts=contacts, limits=Limits(hoap2))
    stop = Stop(duration=2.0, speed=1e-3)
    result = simulate(made, moved, stop)
    assert result.status is RunStatus.NOT_KEPT
    assert "_sole slipped by 20 mm (tick 0)" in result.reason
    assert simulate(made, moved, Stop(2.0, 1e-3, slip=0.03)).status is RunStatus.CONVERGED
    assert simulate(made, moved, Stop(2.0, 1e-3, slip=None)).status is RunStatus.CONVERGED
    soft = dict.fromkeys(("left_sole", "right_sole"), 1e4)
    loose = KinematicController(hoap2, tasks, contacts=contacts, slack=soft)
    assert simulate(loose, moved, stop).status is RunStatus.CONVERGED


COMING = """\
robot: hoap2_like
support: double
tasks: {calm: {type: posture}}
constraints:
  room:
    type: obstacles
    links: [torso]
    things: {ball: {sphere: 0.05, position: [0.5, 0, 0.35], velocity: [-2, 0, 0]}}
stop: {duration: 0.6, speed: null, balance: null, slip: null}
"""


def test_a_margin_that_is_not_kept_is_no_success(tmp_path: Path) -> None:
    """A ball comes faster than the robot can give way, whose feet are held."""
    result = problem(tmp_path, text=COMING).run()
    assert result.status is RunStatus.NOT_KEPT
    assert "room exceeded by" in result.reason
    assert result.clearance["room"].where.endswith(" vs ball")
    assert result.clearance["room"].value == result.history.clearance["room"].min() < -0.02
    told = result.summary()["constraints"]["room"]
    assert told["least_clearance"] == result.clearance["room"].value
    assert problem(tmp_path, {"stop.margins": None}, COMING).run().status.good
    assert problem(tmp_path, {"constraints.room.slack": 1.0}, COMING).run().status.good
    still = problem(tmp_path, {"constraints.room.things.ball.velocity": [0, 0, 0]}, COMING).run()
    assert still.status.good
    # The ball is 0.5 m from the middle of the torso: less its radius, the margin and the torso's.
    assert 0.3 < still.clearance["room"].value < 0.43


def test_what_starts_outside_its_limits_is_brought_back_first(hoap2: Robot) -> None:
    q = hoap2.posture()
    joint = hoap2.joint_index("left_elbow_pitch") - 6
    q[7 + joint] = hoap2.limits.upper[joint] + 0.05
    calm = PostureTask(hoap2, hoap2.posture(), weight=0.1)
    made = KinematicController(hoap2, [calm], limits=Limits(hoap2))
    result = simulate(made, q, Stop(duration=1.0, speed=None))
    assert result.margin.value == pytest.approx(-0.05)
    assert result.status is RunStatus.COMPLETED, result.reason
    free = KinematicController(hoap2, [PostureTask(hoap2, q)])
    stays = simulate(free, q, Stop(duration=0.1, speed=None))
    assert stays.status is RunStatus.COMPLETED  # no limits were asked for
