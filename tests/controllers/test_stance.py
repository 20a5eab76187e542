"""Static torques against Pinocchio's gravity and moments in closed form; bad input of torques."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import wbc
from tests.conftest import MIXED
from wbc.errors import InvalidInputError, UnknownNameError, WbcError
from wbc.robot import Robot, Snapshot

Load = Callable[[str], Robot]


def standing(robot: Robot) -> Snapshot:
    return robot.snapshot(robot.posture("standing"), np.zeros(robot.nv))


@pytest.mark.parametrize("name", ["g1", "talos", "hoap2_like", "icub", "romeo"])
def test_torques_and_forces_balance_gravity(name: str, robot_named: Load) -> None:
    """Oracle: Pinocchio's generalized gravity; forces inside the exact cones."""
    robot = robot_named(name)
    here = standing(robot)
    stance = wbc.stance_torques(here, wbc.support(here, "double"))
    assert stance.ok and stance.report() == "can stand"
    model, data = robot.model, robot.model.createData()
    needed = pin.computeGeneralizedGravity(model, data, here.q)
    pin.computeJointJacobians(model, data, here.q)
    pin.updateFramePlacements(model, data)
    for frame, wrench in stance.forces.items():
        J = pin.getFrameJacobian(model, data, model.getFrameId(frame), pin.LOCAL_WORLD_ALIGNED)
        needed -= J.T @ wrench
        assert np.hypot(*wrench[:2]) <= 0.6 * wrench[2] + 1e-6 * robot.mass
    size = 9.81 * robot.mass
    # The base's balance is a cost of 1e6 beside torques of 1e-3: it is missed by their ratio.
    np.testing.assert_allclose(needed[:6], 0.0, atol=1e-4 * size)
    np.testing.assert_allclose(needed[6:], stance.torque, atol=1e-9 * size)


def test_joints_that_are_too_weak_are_named(robot_named: Load) -> None:
    robot = Robot.load("g1", effort={"*knee*": 5.0})
    here = standing(robot)
    stance = wbc.stance_torques(here, wbc.support(here, "double"))
    assert not stance.ok and stance.held
    assert set(stance.overloaded) == {"left_knee_joint", "right_knee_joint"}
    needed, most = stance.overloaded["left_knee_joint"]
    assert most == 5.0 and abs(needed) > 5.0
    assert "left_knee_joint needs" in stance.report() and "has 5" in stance.report()
    strong = wbc.stance_torques(here, wbc.support(here, "double"), torque_limits=3.0)
    assert strong.ok


def test_a_com_beyond_the_sole_cannot_be_borne(robot_named: Load) -> None:
    """At most the weight times the distance from the CoM to the sole is left as a moment."""
    robot = robot_named("g1")
    here = standing(robot)
    stance = wbc.stance_torques(here, wbc.support(here, "left"))
    assert not stance.held and "no forces of left_sole" in stance.report()
    reach = np.linalg.norm(here.com[:2] - here.position("left_sole")[:2])
    assert 0.0 < np.linalg.norm(stance.unheld[3:]) < 9.81 * robot.mass * reach
    floating = wbc.stance_torques(here, ())
    assert np.linalg.norm(floating.unheld[:3]) == pytest.approx(9.81 * robot.mass)


def test_contacts_in_the_air_are_said(robot_named: Load) -> None:
    robot = robot_named("g1")
    here = standing(robot)
    contacts = wbc.support(here, "double")
    q = here.q.copy()
    q[2] += 0.05
    there = robot.snapshot(q, np.zeros(robot.nv))
    stance = wbc.stance_torques(there, contacts)
    assert stance.displaced == pytest.approx({"left_sole": 0.05, "right_sole": 0.05})
    assert not stance.ok and "50 mm from its anchor" in stance.report()
    tasks = [wbc.PostureTask(robot, here.q)]
    controller = wbc.TorqueController(robot, tasks, contacts=contacts)
    tick = controller.step(there)
    assert tick.displaced == pytest.approx(stance.displaced)
    assert "'left_sole' is 50 mm from its anchor" in tick.report()
    assert np.isfinite(tick.torque).all()
    assert not controller.step(here).displaced


def test_missing_effort_limits_are_said_by_name(
    caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    path = tmp_path / "weak.urdf"
    path.write_text(re.sub('effort="[^"]*"', 'effort="0"', MIXED.read_text()))
    robot = Robot.load(path)
    without = robot.limits.without_effort
    q = robot.postures["neutral"]
    assert without
    with caplog.at_level(logging.WARNING):
        wbc.TorqueController(robot, [wbc.PostureTask(robot, q)], contacts=())
    assert ", ".join(without) in caplog.text
    assert f"effort={{'{without[0]}': N m}}" in caplog.text
    caplog.clear()
    wbc.TorqueController(robot, [wbc.PostureTask(robot, q)], contacts=(), torque_limits=None)
    assert not caplog.text


def test_bad_input_is_typed(robot_named: Load) -> None:
    robot = robot_named("g1")
    here = standing(robot)
    contacts = wbc.support(here, "double")
    controller = wbc.TorqueController(robot, [wbc.PostureTask(robot, here.q)], contacts=contacts)
    bad = here.q.copy()
    bad[9] = np.nan
    for make in (
        lambda: controller.step(None),
        lambda: controller.step(robot.snapshot(bad)),
        lambda: controller.step(robot.snapshot(here.q, np.full(robot.nv, np.inf))),
        lambda: wbc.stance_torques(None, contacts),
        lambda: wbc.stance_torques(here, contacts[0]),
        lambda: wbc.stance_torques(here, ["left_sole"]),
        lambda: wbc.stance_torques(here, contacts, torque_limits=0.0),
        lambda: wbc.stance_torques(here, [wbc.Contact.hold(here, "torso_link")]),
    ):
        with pytest.raises(WbcError):
            make()


def test_a_robot_without_feet_is_told_so() -> None:
    robot = Robot.load(MIXED)
    here = robot.snapshot(robot.postures["neutral"])
    assert not robot.feet
    with pytest.raises((UnknownNameError, InvalidInputError), match=r"f(oo|ee)t"):
        wbc.support(here, "double")
