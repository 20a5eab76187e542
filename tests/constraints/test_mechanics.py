"""Mimic joints are driven as their gear says, and a fixed base stays, without being asked to."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from tests.urdf import geared_arm
from wbc import KinematicController, PositionTask, PostureTask
from wbc.constraints.limits import Limits
from wbc.controllers.loop_closing import _reachable_share
from wbc.robot import Robot


def arm(folder: Path) -> Path:
    path = folder / "arm.urdf"
    path.write_text(geared_arm())
    return path


def joints(robot: Robot, q: np.ndarray) -> dict[str, float]:
    return dict(zip(robot.joint_names, robot.limits.joint_positions(q).tolist(), strict=True))


def test_postures_follow_the_gears(tmp_path: Path) -> None:
    robot = Robot.load(arm(tmp_path))
    found = joints(robot, robot.posture("neutral", {"a": 0.3, "b": 0.4}))
    assert found == pytest.approx({"a": 0.3, "b": 0.4, "c": -0.7, "d": -0.35})
    found = joints(robot, robot.posture("standing"))
    assert found == pytest.approx({"a": 0.0, "b": 0.0, "c": 0.1, "d": 0.05})


def test_controllers_hold_the_gears(tmp_path: Path) -> None:
    robot = Robot.load(arm(tmp_path))
    q = robot.posture("neutral", {"a": 0.3, "b": 0.4})
    target = robot.snapshot(robot.posture("neutral", {"a": 0.6, "b": 0.1})).position("link_d")
    tasks = [PositionTask(robot, "link_d", target), PostureTask(robot, q, weight=0.01)]
    controller = KinematicController(robot, tasks, limits=Limits(robot), dt=0.01)
    controller.set_contacts(controller.contacts)  # which holds them once all the same
    held = ["bolted base", "gear of c", "gear of d"]
    assert [contact.name for contact in controller.contacts] == held
    start = q
    for _ in range(50):
        q = robot.integrate(q, controller.step(robot.snapshot(q)).velocity, 0.01)
        now = joints(robot, q)
        assert now["c"] == pytest.approx(-2 * now["b"] + 0.1, abs=1e-6)
        assert now["d"] == pytest.approx(-now["b"] + 0.05, abs=1e-6)
        np.testing.assert_allclose(q[:7], start[:7], atol=1e-9)
    assert abs(now["b"] - 0.4) > 0.01


def test_what_follows_a_locked_joint_is_locked(tmp_path: Path) -> None:
    robot = Robot.load(arm(tmp_path), locked={"b": 0.4})
    assert robot.joint_names == ("a",)
    whole = Robot.load(arm(tmp_path))
    q, other = whole.posture("neutral", {"b": 0.4}), robot.posture("neutral")
    np.testing.assert_allclose(whole.snapshot(q).com, robot.snapshot(other).com, atol=1e-12)


def test_an_equality_of_joints_is_a_gear(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco model="arm"><worldbody><body name="stand"><geom size="0.1" mass="1"/>'
        '<body name="one"><joint name="a" axis="0 1 0"/><geom size="0.1" mass="1"/>'
        '<body name="two"><joint name="b" axis="0 1 0"/><geom size="0.1" mass="1"/>'
        '</body></body></body></worldbody><equality><joint joint1="b" joint2="a"'
        ' polycoef="0.1 3 0 0 0"/></equality></mujoco>'
    )
    robot = Robot.load(path)
    assert joints(robot, robot.posture("neutral", {"a": 0.2}))["b"] == pytest.approx(0.7)


OFF = {"ratio -2": 1.0, "ratio -2, a little": 0.05, "follower of a follower": -0.6}


@pytest.mark.parametrize("braking", ["free", "bounded"])
@pytest.mark.parametrize("case", OFF)
def test_gears_that_begin_off_come_back_as_fast_as_limits_allow(tmp_path, case, braking) -> None:
    """At 2 rad/s, from rest at 20 rad/s^2: as measured after power-up, or in a posture of zeros."""
    robot = Robot.load(arm(tmp_path))
    q, v, dt = robot.posture("neutral"), np.zeros(robot.nv), 0.01
    q[robot.joint_index("d" if "follower" in case else "c") + 1] += OFF[case]
    wanted = robot.posture("neutral", {"a": 0.3, "b": -0.4})
    limits = Limits(robot, braking=braking)
    controller = KinematicController(
        robot, [PostureTask(robot, wanted)], limits=limits, dt=dt, on_failure="raise"
    )
    together, late = None, 0
    for k in range(300):
        tick = controller.step(robot.snapshot(q, v))
        assert tick.ok and (np.abs(tick.velocity[6:]) <= 2.0 + 1e-6).all()
        late += bool(tick.late)
        if tick.late:
            assert "off, and limits let it come back only so fast: gear of c" in tick.report() or (
                "gear of d" in tick.report()
            )
        v = tick.velocity
        q = robot.integrate(q, v, dt)
        found = joints(robot, q)
        off = max(abs(found["c"] + 2.0 * found["b"] - 0.1), abs(found["d"] - 0.5 * found["c"]))
        if off > 1e-9:
            together = None
        elif together is None:
            together = k * dt
    # Both ends move: 3 rad/s of the gear of c, up to 2.5 of that of d.
    assert together is not None and together < abs(OFF[case]) / 2.0 + 0.2
    assert late > 0
    np.testing.assert_allclose(q[7:], wanted[7:], atol=1e-6)


def test_what_a_box_lets_rows_take_back_is_found_at_its_corners(rng) -> None:
    for _ in range(30):
        J, rate = rng.normal(size=(2, 4)), 4.0 * rng.normal(size=2)
        box = -rng.uniform(0.1, 1.0, 4), rng.uniform(0.1, 1.0, 4)
        rates = np.array([J @ corner for corner in product(*zip(*box, strict=True))])
        farthest = (-np.sign(rate) * rates).max(axis=0)
        assert _reachable_share(J, rate, box) == pytest.approx(min(1.0, *(farthest / np.abs(rate))))
