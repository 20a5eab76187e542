"""Corners that touch the ground, by how high a pitched sole lifts them."""

import numpy as np
import pytest

from wbc.retargeting.footsteps import pitched, touching
from wbc.robot import Robot


@pytest.mark.parametrize("name", ["g1", "talos", "romeo", "icub", "hoap2_like"])
def test_corners_that_stand_are_the_lowest_of_a_pitched_sole(name: str) -> None:
    polygon = Robot.load(name).feet["left"].polygon
    sole = np.column_stack((polygon, np.zeros(len(polygon))))
    for pitch in (-0.5, -0.1, 0.0, 0.1, 0.3):
        R = pitched(np.zeros(1), np.array([pitch]))[0]
        (own,) = touching(polygon, np.array([pitch]))
        lifted = own @ R[2] - (sole @ R[2]).min()
        # Romeo's front is round: a corner 3.7 mm behind it is 1.8 mm above the ground.
        assert lifted.max() < 1e-3
        assert len(np.unique(own.round(9), axis=0)) >= (2 if pitch else len(polygon))
