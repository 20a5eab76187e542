"""What legs lack for walking is said before they walk."""

import logging

import numpy as np
import pinocchio as pin
import pytest

from tests.conftest import load
from wbc.gait import Walker
from wbc.gait.ability import bearing_torques
from wbc.problem import load_problem
from wbc.robot import Robot


@pytest.mark.parametrize("name", ["hoap2_like", "g1"])
def test_bearing_torques_are_those_of_a_tilted_gravity(name: str) -> None:
    """By Pinocchio: recursive Newton-Euler at rest, with gravity along the pressure's line."""
    robot: Robot = load(name)
    s = robot.snapshot(robot.posture())
    foot = robot.feet["left"].frame
    model, arm = robot.model.copy(), s.com - s.position(foot)
    model.gravity.linear = -9.81 / arm[2] * arm
    force = -robot.mass * model.gravity.linear
    frame = model.frames[robot.frame_id(foot)]
    push = pin.StdVec_Force(model.njoints, pin.Force.Zero())
    local = pin.Force(s.rotation(foot).T @ force, np.zeros(3))
    push[frame.parentJoint] = frame.placement.act(local)
    zero = np.zeros(robot.nv)
    tau = pin.rnea(model, model.createData(), s.q, zero, zero, push)
    np.testing.assert_allclose(tau[:6], 0.0, atol=1e-9)  # the line goes through the CoM
    np.testing.assert_allclose(bearing_torques(s, foot), tau[6:], atol=1e-9)


@pytest.mark.parametrize("name", ["hoap2_like", "g1"])
def test_robots_that_walk_lack_nothing(name: str) -> None:
    assert Walker(load(name)).notes == ()


def test_weak_joints_are_named(caplog: pytest.LogCaptureFixture) -> None:
    robot = Robot.load("hoap2_like", effort={"*_hip_roll": 1.5})
    with caplog.at_level(logging.WARNING):
        (note,) = Walker(robot).notes
    assert "left_hip_roll takes 2.09 and has 1.5, right_hip_roll" in note
    assert "left_ankle" not in note
    assert note.endswith("give the joint's, as effort={'left_hip_roll': ...}")
    assert note in caplog.text
    assert Walker(robot, torque_limits=None).notes == ()  # they are not bounded there
    assert Walker(robot, torque_limits=2.0).notes == ()


def test_legs_of_five_joints() -> None:
    locked = {"left_ankle_roll": 0.0, "right_ankle_roll": 0.0}
    (note,) = Walker(Robot.load("hoap2_like", locked=locked)).notes
    assert "the left leg has 5 and the right leg has 5 of the six joints" in note


def test_a_simulation_says_it_too(tmp_path) -> None:
    file = tmp_path / "walk.yaml"
    file.write_text(
        "robot: {model: hoap2_like, effort: {left_hip_roll: 1.5}}\n"
        "gait: {commands: [{at: 0.0, vx: 0.1}]}\n"
        "simulation: {duration: 0.01}\n"
    )
    result = load_problem(file).simulate()
    assert any("left_hip_roll takes 2.09 and has 1.5" in note for note in result.notes)
