"""Contact corners of a pitched sole are its lowest."""

import numpy as np
import pytest

import wbc
from tests.retargeting.humans import moving
from wbc.retargeting.footsteps import contact_corners, yaw_pitch_rotations
from wbc.robot import Robot


@pytest.mark.parametrize("name", ["g1", "talos", "romeo", "icub", "hoap2_like"])
def test_contact_corners_are_the_lowest_of_a_pitched_sole(name: str) -> None:
    polygon = Robot.load(name).feet["left"].polygon
    sole = np.column_stack((polygon, np.zeros(len(polygon))))
    for pitch in (-0.5, -0.1, 0.0, 0.1, 0.3):
        R = yaw_pitch_rotations(np.zeros(1), np.array([pitch]))[0]
        (own,) = contact_corners(polygon, np.array([pitch]))
        lifted = own @ R[2] - (sole @ R[2]).min()
        # Romeo's front is round: a corner 3.7 mm behind it is 1.8 mm above the ground.
        assert lifted.max() < 1e-3
        assert len(np.unique(own.round(9), axis=0)) >= (2 if pitch else len(polygon))


def test_a_squat_is_no_twist_where_thighs_are_wider_than_soles() -> None:
    """Thighs kept their margin by a turned pelvis, one knee bent by half a radian more."""
    still, rows = np.zeros((75, 3)), np.linspace(0.0, 1.0, 75)
    dip = 0.05 * (1.0 - np.cos(2.0 * np.pi * rows))
    human = moving(1.5, 0.0 * rows, dip, {"left": still, "right": still}, 0.0 * rows)
    robot = Robot.load("romeo")
    q = wbc.retarget(human, robot).q
    left, right = (q[:, 7 + robot.joint_names.index(f"{side}KneePitch")] for side in "LR")
    np.testing.assert_allclose(left, right, atol=0.15)
