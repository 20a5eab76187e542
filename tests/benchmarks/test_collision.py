"""The benchmark of margins: where pairs that stand near keep less than the others."""

import collision
import numpy as np
import pytest

from wbc.constraints import Limits, SelfCollision
from wbc.robot import Robot


@pytest.mark.slow
def test_an_episode_begins_outside_all_margins_and_keeps_them() -> None:
    robot = Robot.load("hoap2_like")
    limits = Limits(robot)
    margins = SelfCollision(robot, margin=collision.MARGIN, pairs=collision.PAIRS, limits=limits)
    assert margins.margins.min() < collision.MARGIN  # what once made it search for ever
    rng, record = np.random.default_rng(0), collision.Record()
    q = collision.clear_posture(robot, margins, rng)
    assert (margins.model.nearest(robot.snapshot(q)).distance > margins.margins).all()
    collision.episode(robot, margins, limits, "double", rng, "daqp", record)
    assert record.ticks == collision.EPISODE and set(record.statuses) == {"solved"}
    assert record.broken < 1e-6
