"""The DCM in closed form against the pendulum's equation integrated step by step."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wbc.gait.dcm import StepTimes, VrpSegment, dcm_offsets, shift_gain

OMEGA = 3.9


def integrated(dcm: np.ndarray, segments: list[VrpSegment]) -> np.ndarray:
    """Return the DCM after segments, by Runge-Kutta of xi' = omega (xi - vrp)."""
    for segment in segments:

        def rate(t: float, xi: np.ndarray, segment: VrpSegment = segment) -> np.ndarray:
            done = t / segment.duration
            return OMEGA * (xi - (1.0 - done) * segment.start - done * segment.end)

        found = solve_ivp(rate, (0.0, segment.duration), dcm, rtol=1e-11, atol=1e-13)
        dcm = found.y[:, -1]
    return dcm


def test_backwards_is_what_forwards_undoes(rng: np.random.Generator) -> None:
    for _ in range(20):
        segment = VrpSegment(*rng.normal(size=(2, 2)), duration=float(rng.uniform(0.05, 1.0)))
        last = rng.normal(size=2)
        left = float(rng.uniform(0.0, segment.duration))
        here = segment.dcm_before(last, left, OMEGA)
        rest = VrpSegment(segment.at(segment.duration - left), segment.end, left)
        np.testing.assert_allclose(integrated(here, [rest]), last, atol=1e-9)


def test_offsets_lead_from_foot_to_foot(rng: np.random.Generator) -> None:
    times = StepTimes(0.4, 0.07)
    steps = rng.normal(size=(5, 2))
    offsets = dcm_offsets(steps, times, OMEGA, last=rng.normal(size=2))
    foot = rng.normal(size=2)
    dcm = foot + offsets[0]
    for k, step in enumerate(steps):
        on_one = VrpSegment(foot, foot, times.single)
        shifting = VrpSegment(foot, foot + step, times.double)
        foot = foot + step
        dcm = integrated(dcm, [on_one, shifting])
        np.testing.assert_allclose(dcm, foot + offsets[k + 1], atol=1e-8)


def test_without_a_last_offset_the_walk_ends_over_the_last_foot() -> None:
    offsets = dcm_offsets([np.ones(2)], StepTimes(0.4, 0.1), OMEGA)
    assert offsets[-1] == 0.0


@pytest.mark.parametrize("double", [0.0, 1e-12, 1e-6])
def test_a_shift_in_no_time_pushes_nothing_back(double: float) -> None:
    assert shift_gain(OMEGA, double) == pytest.approx(1.0, abs=3e-6)
