"""Joints whose names would be patterns mean themselves."""

import numpy as np
import pytest

from wbc.robot import Robot
from wbc.robot.names import matches

LINK = (
    '<link name="{0}"><inertial><mass value="1"/>'
    '<inertia ixx=".01" ixy="0" ixz="0" iyy=".01" iyz="0" izz=".01"/></inertial></link>'
)
JOINT = (
    '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="0 1 0"/>'
    '<limit lower="-1" upper="1" effort="10" velocity="3"/></joint>'
)


def two_joints(first: str, second: str) -> str:
    links = "".join(LINK.format(name) for name in ("trunk", "upper", "lower"))
    joints = JOINT.format(first, "trunk", "upper") + JOINT.format(second, "upper", "lower")
    return f'<robot name="arm">{links}{joints}</robot>'


@pytest.mark.parametrize(("first", "second"), [("j[0]", "j0"), ("j*", "j2"), ("j?", "j1")])
def test_name_that_would_be_a_pattern_means_its_own_joint_alone(first: str, second: str) -> None:
    robot = Robot.load(two_joints(first, second))
    np.testing.assert_array_equal(robot.posture("neutral", {first: 0.3})[7:], [0.3, 0.0])
    np.testing.assert_array_equal(robot.posture("neutral", {second: 0.3})[7:], [0.0, 0.3])
    loaded = Robot.load(two_joints(first, second), locked={first: 0.2}, effort={second: 5.0})
    assert loaded.joint_names == (second,)
    np.testing.assert_array_equal(loaded.limits.effort, [5.0])


def test_pattern_that_is_no_name_matches_as_before() -> None:
    assert matches("j[01]", ("j0", "j1", "k")) == (0, 1)
    assert matches("*", ("j0", "j1")) == (0, 1)
    assert matches("l", ("j0", "j1")) == ()
