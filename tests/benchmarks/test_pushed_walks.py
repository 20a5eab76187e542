"""Pushed walks: bounds, against a pendulum with all controls at theirs; the table by variants."""

import math

import pytest
import walk_ablation as ablation
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


def rows(variant: str, *impulses: float) -> list[dict[str, object]]:
    """Two seeds, pushed from the back at two phases."""
    places = [(seed, phase) for seed in (0, 1) for phase in (0, 3)]
    return [
        {"variant": variant, "seed": seed, "side": "back", "phase": phase, "impulse": impulse}
        for (seed, phase), impulse in zip(places, impulses, strict=True)
    ]


def test_means_are_compared_where_all_variants_were_pushed() -> None:
    found = [*rows("regulated", 30.0, 40.0, 34.0, 44.0), *rows("planned", 33.0, 48.0, 37.0, 48.0)]
    alone = {**found[-1], "side": "left", "impulse": 90.0}
    bounds = {"pendulum": {("back", 0): 50.0, ("back", 3): 60.0}}
    lines = ablation.table([*found, alone], bounds).splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert cells[0] == ["pushed", "regulated", "planned", "pendulum"]
    assert [row[0] for row in cells[2:4]] == ["back, 0/4", "back, 3/4"]
    assert [float(one) for one in cells[-2][1:]] == pytest.approx([37.0, 41.5, 55.0])
    assert [float(one) for one in cells[-1][1:]] == pytest.approx([1.0, 1.12, 1.49])
