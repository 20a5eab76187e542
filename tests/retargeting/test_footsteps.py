"""Contact corners of a pitched sole are its lowest."""

import numpy as np
import pytest

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
