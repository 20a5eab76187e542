"""Joints whose names would be patterns mean themselves."""

import numpy as np
import pytest

from tests.urdf import joint, link, robot
from wbc.robot import Robot
from wbc.robot.names import matches


def two_joints(first: str, second: str) -> str:
    links = map(link, ("trunk", "upper", "lower"))
    return robot("arm", *links, joint(first, "trunk", "upper"), joint(second, "upper", "lower"))


@pytest.mark.parametrize(("first", "second"), [("j[0]", "j0"), ("j*", "j2"), ("j?", "j1")])
def test_name_that_would_be_a_pattern_means_its_own_joint_alone(first: str, second: str) -> None:
    arm = Robot.load(two_joints(first, second))
    np.testing.assert_array_equal(arm.posture("neutral", {first: 0.3})[7:], [0.3, 0.0])
    np.testing.assert_array_equal(arm.posture("neutral", {second: 0.3})[7:], [0.0, 0.3])
    loaded = Robot.load(two_joints(first, second), locked={first: 0.2}, effort={second: 5.0})
    assert loaded.joint_names == (second,)
    np.testing.assert_array_equal(loaded.limits.effort, [5.0])


def test_pattern_that_is_no_name_matches_as_before() -> None:
    assert matches("j[01]", ("j0", "j1", "k")) == (0, 1)
    assert matches("*", ("j0", "j1")) == (0, 1)
    assert matches("l", ("j0", "j1")) == ()


def test_what_the_file_calls_as_the_centre_of_mass_is_told() -> None:
    """Moments about="com" were about the robot's CoM, and nobody said."""
    arm = Robot.load(two_joints("j0", "j1").replace('"lower"', '"com"'), base="floating")
    assert any("'com' means the centre of mass" in note for note in arm.notes)
    assert not any("'com'" in note for note in Robot.load(two_joints("j0", "j1")).notes)
