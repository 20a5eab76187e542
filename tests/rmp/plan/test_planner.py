"""What the planner finds, how it fails and how it starts warm."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.planner import example
from tests.rmp.plan.conftest import HEIGHT, LIMITS, RADII
from wbc.errors import InvalidInputError
from wbc.rmp.plan import (
    PathLimits,
    Plan,
    PlanError,
    PlanPhase,
    PlanProblem,
    State,
    Weights,
    at_rest,
    check,
    rectangle,
    solve,
)
from wbc.rmp.solid import SolidRmp

STILL = (0.0, 0.0, 0.0)
SQUARE = rectangle(0.0, 0.0, 0.22, 0.3)
Planned = Callable[[str], Plan]


def test_linear_inverted_pendulum_in_closed_form() -> None:
    """At constant height, without spin, c'' = omega^2 (c - p): for CoPs linear in time."""
    flat = PathLimits(leg_length=(0.5, 1.0), radius=(0.05, 0.4))
    start = replace(at_rest((0.0, 0.0, HEIGHT), RADII), com_velocity=(0.2, 0.1, 0.0))
    plan = solve(
        PlanProblem(
            SolidRmp(30.0),
            (PlanPhase("stand", 1.0, SQUARE, 20),),
            start=start,
            goal=State(com=(0.0, 0.0, None), com_velocity=STILL),
            nominal=State(com=(None, None, HEIGHT)),
            limits=flat,
            weights=Weights(torque=1e4, momentum=1e4, com=1e5, acceleration=0.01),
        )
    )
    omega = np.sqrt(9.81 / HEIGHT)
    k = plan.knots
    c, v = np.array(k.com[0, :2]), np.array(k.com_velocity[0, :2])
    h = 0.05
    for p0, p1 in zip(k.cop[:-1], k.cop[1:], strict=True):
        slope = (p1 - p0) / h
        cosh, sinh = np.cosh(omega * h), np.sinh(omega * h)
        c, v = (
            p1 + cosh * (c - p0) + sinh * (v - slope) / omega,
            slope + omega * sinh * (c - p0) + cosh * (v - slope),
        )
    # The plan's force is linear in each interval, the pendulum's hyperbolic: 1e-4 of 0.3 m seen.
    assert np.abs(c - k.com[-1, :2]).max() < 5e-4
    assert np.abs(v - k.com_velocity[-1, :2]).max() < 2e-3


def test_radii_are_bounded_by_default() -> None:
    """Only the CoM's start and the end at rest are given, and no cost holds the masses."""
    standing = PlanProblem(
        SolidRmp(30.0),
        (PlanPhase("stand", 2.0, SQUARE, 20),),
        start=State(com=(0.0, 0.0, HEIGHT)),
        goal=State(com=(0.0, 0.0, HEIGHT), com_velocity=STILL, rotation=STILL, momentum=STILL),
        weights=Weights(radii=0.0, radius_acceleration=0.0),
    )
    plan = solve(standing)
    assert plan.knots.radii.max() <= 1.0 + 1e-8  # 30 km without bounds
    seen = check(plan)
    assert seen.ok
    assert "radius (greatest)" in [each.quantity for each in seen.limits]
    with pytest.raises(InvalidInputError, match="radii: 2 is not within"):
        replace(standing, start=State(radii=(2.0, 2.0, 2.0)))
    replace(standing, start=State(radii=(2.0, 2.0, 2.0)), limits=PathLimits(radius=(0.1, np.inf)))


def test_walk_repeats_itself(planned: Planned) -> None:
    k = planned("walk").knots
    np.testing.assert_allclose(k.com[-1] - k.com[0], (0.5, 0.0, 0.0), atol=1e-8)
    np.testing.assert_allclose(k.com_velocity[-1], k.com_velocity[0], atol=1e-7)
    np.testing.assert_allclose(k.force[-1], k.force[0], atol=1e-5)
    assert np.abs(k.momentum).max() <= 3.0 + 1e-9


def test_duration_is_chosen_within_its_bounds(planned: Planned) -> None:
    swift = replace(example("hop"), weights=Weights(time=100.0))
    plan, calm = solve(swift), planned("hop")
    assert plan.duration < calm.duration - 0.1
    for T, phase in zip(plan.durations, swift.schedule, strict=True):
        assert phase.durations[0] - 1e-7 <= T <= phase.durations[1] + 1e-7


def test_a_plan_that_cannot_be_names_what_is_in_the_way() -> None:
    # In 0.1 s gravity alone brings the CoM down by 5 cm, not 20.
    sunk = PlanProblem(
        SolidRmp(30.0),
        (PlanPhase("stand", 0.1, SQUARE, 8),),
        start=at_rest((0.0, 0.0, HEIGHT), RADII),
        goal=at_rest((0.0, 0.0, HEIGHT - 0.2), RADII),
        limits=LIMITS,
    )
    with pytest.raises(PlanError) as caught:
        solve(sunk)
    error = caught.value
    worst = error.violations[0]
    assert (worst.phase, worst.quantity, worst.unit) == ("goal", "com", "m")
    assert 0.1 < worst.amount < 0.2
    assert "goal: com" in str(error) and "0.100 s" in str(error)
    assert check(error.attempt).defect < 1e-6  # it is a motion


@pytest.mark.slow
def test_warm_start_takes_fewer_iterations_also_for_other_numbers() -> None:
    pushed = example("push")
    less = replace(pushed, start=replace(pushed.start, com_velocity=(0.27, 0.0, 0.0)))
    cold = solve(pushed)
    again = solve(pushed, warm=cold)
    other, other_cold = solve(less, warm=cold), solve(less)
    assert again.stats.iterations <= 2 and again.stats.warm
    assert other.stats.iterations < other_cold.stats.iterations
    np.testing.assert_allclose(other.knots.com, other_cold.knots.com, atol=1e-5)
    with pytest.raises(InvalidInputError, match="warm start"):
        solve(example("lean"), warm=cold)


def test_verbose_prints_size_and_verdict(capfd: pytest.CaptureFixture[str]) -> None:
    plan = solve(example("lean"), verbose=True)
    shown = capfd.readouterr().out
    assert f"{plan.stats.variables} variables" in shown and "Solve_Succeeded" in shown


def test_what_is_no_problem_plan_or_count_is_refused() -> None:
    problem = example("lean")
    for build, message in (
        (lambda: solve(None), "problem: expected a PlanProblem"),
        (lambda: solve(problem, problem), "warm: expected a Plan or None"),
        (lambda: solve(problem, iterations=20.5), "iterations: expected a whole number"),
        (lambda: check(problem), "plan: expected a Plan"),
    ):
        with pytest.raises(InvalidInputError, match=message):
            build()
