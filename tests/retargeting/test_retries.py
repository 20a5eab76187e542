"""Retries of a motion: what is given up until all constraints are satisfied."""

import numpy as np
import pytest

import wbc
from tests.retargeting.humans import crouching, stepping
from wbc.retargeting import pipeline, retries
from wbc.retargeting.constraint_projection import Projection
from wbc.robot import Robot


def long_axis_error(found: wbc.Retargeted) -> float:
    """Return the largest angle of the ellipsoid's long axis from the human's [deg]."""
    return next(one.largest for one in found.reached if one.task == "principal axis 1")


@pytest.mark.slow
def test_first_attempt_with_higher_weights_follows_more_closely(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    human, robot = stepping(), Robot.load("hoap2_like")
    higher = wbc.retarget(human, robot)
    monkeypatch.setattr(retries, "FIRST_ATTEMPT", dict.fromkeys(retries.FIRST_ATTEMPT, 1.0))
    plain = wbc.retarget(human, robot)
    off = [
        np.square(one.whole.momentum[:, 3:] - one.targets.angular_momentum).sum()
        for one in (higher, plain)
    ]
    assert long_axis_error(higher) < long_axis_error(plain) and off[0] < 1.05 * off[1]
    assert not higher.broken


def test_infeasible_attempts_return_the_least_infeasible(
    hoap2: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lower weights may be worse: the last attempt of a Unitree H1's kick slid by 36 mm."""
    feet, made = [0.03, 0.04, 0.002, 0.05, 0.01, 0.02, 0.04], list[Projection]()

    def project(problem: object, q: np.ndarray, *, stop_early: bool = False) -> Projection:
        made.append(Projection(q + len(made), feet[len(made)], 0.0, 0.0, 0.5, 0.5))
        return made[-1]

    monkeypatch.setattr(retries, "project_onto_constraints", project)
    monkeypatch.setattr(pipeline, "evaluate", lambda *given: given)
    q = wbc.retarget(crouching(2.0), hoap2, rounds=1)[5]
    assert len(made) == 7 and np.array_equal(q, made[2].q)
