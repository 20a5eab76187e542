"""What is given up of a motion until what is hard is kept."""

import numpy as np
import pytest

import wbc
from tests.retargeting.humans import stepping
from wbc.retargeting import tries
from wbc.robot import Robot


def leaning(found: wbc.Retargeted) -> float:
    """Return how far the ellipsoid's long axis is from the human's at most [deg]."""
    return next(one.largest for one in found.reached if one.task == "principal axis 1")


@pytest.mark.slow
def test_more_is_asked_first_where_all_that_is_hard_is_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    human, robot = stepping(), Robot.load("hoap2_like")
    eager = wbc.retarget(human, robot)
    monkeypatch.setattr(tries, "EAGER", dict.fromkeys(tries.EAGER, 1.0))
    plain = wbc.retarget(human, robot)
    off = [
        np.square(one.whole.momentum[:, 3:] - one.targets.angular_momentum).sum()
        for one in (eager, plain)
    ]
    assert leaning(eager) < leaning(plain) and off[0] < 1.05 * off[1]
    assert not eager.broken
