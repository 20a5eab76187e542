"""Closed paths of joints, and their rounds from rest to rest."""

from typing import Any

import numpy as np
import pytest

import wbc
from wbc.flight.rounds import JointLoop, Rounds, even_phases

JOINTS = {"left_hip_pitch": (0.2, -0.1, 0.5, 0.0), "right_knee_pitch": (-0.3, 0.0, 0.0, 0.1)}


@pytest.fixture(scope="module")
def rounds(hoap2: wbc.Robot) -> Rounds:
    return Rounds.of(hoap2, hoap2.posture("standing"), JOINTS, 3, 2.0)


def test_a_loop_is_its_fourier_series() -> None:
    loop = JointLoop(np.array([0.4]), np.array([[0.2], [-0.1], [0.5], [0.0]]))
    p = 0.7
    wanted = 0.4 + 0.2 * (np.cos(p) - 1) - 0.1 * (np.cos(2 * p) - 1) + 0.5 * np.sin(p)
    np.testing.assert_allclose(loop.at(np.array([p])), [[wanted]], atol=1e-15)
    np.testing.assert_allclose(loop.at(np.array([0.0, 2 * np.pi])), 0.4, atol=1e-15)


@pytest.mark.parametrize("derivative", [1, 2])
def test_derivatives_by_the_phase(derivative: int) -> None:
    loop = JointLoop(np.zeros(2), np.random.default_rng(0).standard_normal((6, 2)))
    phases, h = even_phases(7), 1e-5
    difference = loop.at(phases + h, derivative - 1) - loop.at(phases - h, derivative - 1)
    np.testing.assert_allclose(loop.at(phases, derivative), difference / (2 * h), atol=1e-8)


def test_rounds_begin_and_end_at_rest_in_their_posture(rounds: Rounds) -> None:
    for t in (-1.0, 0.0, rounds.duration, rounds.duration + 1.0):
        q, rate, acceleration = rounds.at(t)
        np.testing.assert_allclose(q, rounds.posture, atol=1e-12)
        np.testing.assert_array_equal(rate, 0.0)
        np.testing.assert_allclose(acceleration, 0.0, atol=1e-12)


def test_rates_and_accelerations_are_those_of_the_postures(
    hoap2: wbc.Robot, rounds: Rounds
) -> None:
    h = 1e-4
    for t in (0.3, 2.1, 5.5):
        before, here, after = (rounds.at(t + k * h) for k in (-1, 0, 1))
        moved = hoap2.difference(before[0], after[0]) / (2 * h)
        np.testing.assert_allclose(here[1], moved, atol=1e-5)
        np.testing.assert_allclose(here[2], (after[1] - before[1]) / (2 * h), atol=1e-4)
        assert (here[1][:6] == 0.0).all()


def test_a_target_in_a_file_is_the_same_path(hoap2: wbc.Robot, rounds: Rounds) -> None:
    target = rounds.target()
    again = Rounds.of(hoap2, rounds.posture, target["loop"], target["cycles"], target["period"])
    np.testing.assert_array_equal(again.coefficients, rounds.coefficients)
    assert again.duration == rounds.duration == 6.0


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"loop": {"left_knee": (0.1, 0.1)}}, "left_knee_pitch"),
        ({"loop": {"left_knee_pitch": (0.1, 0.1, 0.1)}}, r"an even one.*got \[3\]"),
        ({"loop": {**JOINTS, "left_hip_yaw": (0.1, 0.1)}}, r"got \[2, 4\]"),
        # It was held at its limit, and the robot turned less than by the path.
        (
            {"loop": {"left_hip_pitch": (0.0, 3.0)}},
            "hip_pitch' goes to .*outside its limits",
        ),
        ({"cycles": 0}, "cycles"),
        ({"cycles": 1.5}, "cycles"),  # the path ended elsewhere, by up to 0.4 rad
        ({"period": 0.0}, "period"),
    ],
)
def test_mistakes_are_named(hoap2: wbc.Robot, changed: dict[str, Any], words: str) -> None:
    given: dict[str, Any] = {"loop": JOINTS, "cycles": 1, "period": 1.0, **changed}
    with pytest.raises(wbc.WbcError, match=words):
        Rounds.of(hoap2, hoap2.posture("standing"), **given)
