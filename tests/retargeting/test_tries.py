"""What is given up of a motion until what is hard is kept."""

import numpy as np
import pytest

import wbc
from tests.retargeting.humans import crouching, stepping
from wbc.retargeting import passes, tries
from wbc.retargeting.mending import Mended
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


def test_of_tries_that_keep_nothing_the_nearest_is_taken(
    hoap2: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Softer ones may go astray: the last one of a Unitree H1's kick slid by 36 mm."""
    lacks, made = [0.03, 0.04, 0.002, 0.05, 0.01, 0.02, 0.04], list[Mended]()

    def mended(motion: object, q: np.ndarray, *, patient: bool = True) -> Mended:
        made.append(Mended(q + len(made), lacks[len(made)], 0.0, 0.0, 0.5, 0.5))
        return made[-1]

    monkeypatch.setattr(tries, "mended", mended)
    monkeypatch.setattr(passes, "judged", lambda *given: given)
    q = wbc.retarget(crouching(0.5), hoap2, rounds=1)[5]
    assert len(made) == 7 and np.array_equal(q, made[2].q)
