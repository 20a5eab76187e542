"""What a gait measures of legs."""

from dataclasses import astuple

import numpy as np
import pytest

from tests.conftest import load
from tests.urdf import drawn_along, on_both_legs
from wbc.errors import InvalidInputError
from wbc.gait.legs import Legs
from wbc.robot import Robot
from wbc.robot.chains import leg_joints


@pytest.mark.parametrize("name", ["hoap2_like", "g1"])
def test_legs_are_measured_wherever_joints_are_drawn_along_their_axes(name: str) -> None:
    """The same mechanism with other origins: one was refused, for hips too near its ankles."""
    text, rng = load(name).path.read_text(), np.random.default_rng(1)
    robot = Robot.load(text, base="floating")
    joints = [robot.model.names[joint] for foot in robot.feet for joint in leg_joints(robot, foot)]
    shifts = dict(zip(joints, rng.uniform(-0.1, 0.1, len(joints)).tolist(), strict=True))
    moved = Robot.load(drawn_along(text, shifts), base="floating")
    masses = [one.snapshot(one.posture("standing")).mass_matrix for one in (robot, moved)]
    np.testing.assert_allclose(*masses, atol=1e-9)
    np.testing.assert_allclose(astuple(Legs.of(moved)), astuple(Legs.of(robot)), rtol=1e-6)


def test_knees_that_lift_no_foot_are_refused(hoap2: Robot) -> None:
    text = on_both_legs(
        hoap2.path.read_text(), r'(_knee_pitch".*?<limit [^/]*?upper=")[^"]*', r"\g<1>0.05"
    )
    with pytest.raises(InvalidInputError, match="left_knee_pitch, does not shorten it to 80 % of"):
        Legs.of(Robot.load(text))
