"""The benchmark of margins: where pairs that stand near keep less than the others."""

import collision
import numpy as np
import pytest

from wbc.constraints import Limits, SelfCollision
from wbc.robot import Robot


@pytest.mark.slow
def test_an_episode_begins_outside_all_margins_and_keeps_them(hoap2: Robot) -> None:
    limits = Limits(hoap2)
    margins = SelfCollision(hoap2, margin=collision.MARGIN, pairs=collision.PAIRS, limits=limits)
    assert margins.margins.min() < collision.MARGIN  # what once made it search for ever
    rng, record = np.random.default_rng(0), collision.Record()
    q = collision.clear_posture(hoap2, margins, rng)
    assert (margins.model.nearest(hoap2.snapshot(q)).distance > margins.margins).all()
    collision.episode(hoap2, margins, limits, "double", rng, "daqp", record)
    assert record.ticks == collision.EPISODE and set(record.statuses) == {"solved"}
    assert record.broken < 1e-6
