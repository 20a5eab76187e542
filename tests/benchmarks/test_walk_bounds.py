"""The bounds of pushed walks, against a pendulum that is integrated with all controls at theirs."""

import math

import pytest
from walk_bounds import Start, Walk, captured, walks
from walk_pushes import LASTING

TIMES = (0.24, 0.3, 0.36, 0.36)
DT = 1e-5  # s: its first-order error grows with exp(omega t) and is 4e-4 of the impulse


def survives(walk: Walk, start: Start, impulse: float, spin: float) -> bool:
    """Whether a pendulum pushed from the back is caught by steps as far ahead as they go.

    ``spin`` is the size of a first rate of kappa, for 0.1 s, and back for as long [m/s^2].
    """
    w, feet, ends, now = walk.omega, [0.0], [], start.double
    for k, time in enumerate(TIMES):
        far = math.sqrt(3.0) / 10.0 * walk.acceleration * time**2
        from_ = feet[k - 1] if k else start.foot + 0.5 * time * start.rate
        feet.append(min(feet[k] + walk.reach[k % 2][1], from_ + far))
        ends.append(now + time)
        now += time + walk.double
    dcm, kappa = start.dcm, 0.0
    for n in range(round(now / DT)):
        t = n * DT
        k = sum(t >= end for end in ends)
        vrp = feet[k]
        if t < start.double:
            vrp = start.foot * (start.double - t) / walk.double
        elif k and t < ends[k - 1] + walk.double:
            vrp = feet[k - 1] + (t - ends[k - 1]) / walk.double * (feet[k] - feet[k - 1])
        push = impulse / LASTING if t < LASTING else 0.0
        kappa += DT * (spin if t < 0.1 else -spin if t < 0.2 else 0.0)
        dcm += DT * (w * (dcm - vrp - walk.sole) - kappa + walk.shove * push)
    return dcm <= feet[-1] + walk.sole


def most(walk: Walk, start: Start, spin: float) -> float:
    """Return the largest impulse that it survives [N s]."""
    low, high = 0.0, 200.0
    while high - low > 0.02:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if survives(walk, start, middle, spin) else (low, middle)
    return low


@pytest.mark.slow
@pytest.mark.parametrize("phase", [0.0, 0.5])
def test_the_bound_is_that_of_a_pendulum_with_all_its_controls_at_theirs(phase: float) -> None:
    walk = walks("g1", "back", 0.0, 0.0)
    start = Start.of(walk, phase)
    assert captured(walk, start, TIMES) == pytest.approx(most(walk, start, 0.0), rel=2e-3)


@pytest.mark.slow
def test_momentum_is_worth_at_least_what_one_turn_to_and_fro_is() -> None:
    """A moment one way and then the other within the bounds, its turn not given back."""
    walk = walks("g1", "back", 35.0, 0.6)
    start = Start.of(walk, 0.0)
    free = walks("g1", "back", 0.0, 0.0)
    assert walk.rate * 0.1**2 < walk.turn
    turned = most(free, start, walk.rate)
    assert turned > 1.03 * captured(free, start, TIMES)
    found = captured(walk, start, TIMES)
    assert turned < found < turned + 8.0
