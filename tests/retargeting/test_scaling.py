"""The human's angular momentum is followed up to a factor, which arms of another mass need."""

import numpy as np
import pytest

import wbc
from tests.retargeting.humans import reaching_up
from wbc.retargeting.scaling import (
    MAX_MOMENTUM_SCALE,
    MIN_MOMENTUM_SCALE,
    momentum_notes,
    momentum_scale,
)
from wbc.robot import Robot


def test_the_factor_is_that_of_least_squares() -> None:
    rng = np.random.default_rng(1)
    (human, other), weights = rng.normal(size=(2, 50, 3)), np.array([1.0, 2.0, 0.5])
    own = 1.7 * human + 0.3 * other
    found = momentum_scale(own, human, weights)
    errors = [
        np.square(weights * (own - s * human)).sum() for s in (found - 1e-3, found, found + 1e-3)
    ]
    assert errors[1] < min(errors[0], errors[2])  # a minimum of the weighted errors
    assert momentum_scale(9.0 * human, human, weights) == MAX_MOMENTUM_SCALE
    assert momentum_scale(-human, human, weights) == MIN_MOMENTUM_SCALE
    assert momentum_scale(own, 0.0 * human, weights) == 1.0  # a human at rest
    assert not momentum_notes(1.1) and "1.70 times" in momentum_notes(1.7)[0]


@pytest.mark.slow
def test_an_arm_is_raised_above_the_head(g1: Robot) -> None:
    """It ended 44 degrees off, others 120: the initial guess left arms that rise fast below."""
    found = wbc.retarget(reaching_up(), g1)
    largest = {one.task: one.largest for one in found.reached}
    assert max(largest["right upper arm"], largest["right forearm"]) < 32.0
    assert min(found.angular_momentum_correlation) > 0.95 and not found.broken
    (note,) = [note for note in found.notes if "times the human's" in note]
    own, human = found.whole.momentum[:, 3:], found.targets.angular_momentum
    assert momentum_scale(own, human, np.ones(3)) == pytest.approx(1.0, abs=0.1)
    assert "angular momentum" in note
