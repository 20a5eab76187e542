"""A plan as targets over time, against differences, Newton and Euler, and the robot itself."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracking.conftest import crouching
from wbc.errors import InvalidInputError
from wbc.rmp.ground import centre_of_pressure
from wbc.rmp.plan import Plan, PlanPhase, solve
from wbc.robot import Snapshot
from wbc.spatial import vech
from wbc.tracking.pendulum import RobotPendulum
from wbc.tracking.reference import STEP, PlanReference

BEGINS = 0.25


@pytest.fixture
def reference(plan: Plan, start: Snapshot) -> PlanReference:
    return PlanReference(plan, start, begins=BEGINS)


def inner_times() -> np.ndarray:
    """On samples, away from where phases meet and accelerations jump."""
    local = np.concatenate((np.arange(0.02, 0.38, 0.03), np.arange(0.42, 0.78, 0.03)))
    return BEGINS + np.round(local / STEP) * STEP


@pytest.mark.parametrize(
    ("value", "rate"),
    [
        ("com", "com_velocity"),
        ("com_velocity", "com_acceleration"),
        ("momentum", "momentum_rate"),
        ("inertia", "inertia_rate"),
        ("inertia_rate", "inertia_acceleration"),
    ],
)
def test_rates_are_derivatives_of_the_values(
    reference: PlanReference, value: str, rate: str
) -> None:
    t = inner_times()
    ahead, behind = reference.at(t + STEP), reference.at(t - STEP)
    slope = (getattr(ahead, value) - getattr(behind, value)) / (2.0 * STEP)
    exact = getattr(reference.at(t), rate)
    # Central differences: h^2/6 of the third derivative, some 1e3 times the rate's size here; and
    # the orientation is a polynomial whose slope is exact at its nodes only.
    np.testing.assert_allclose(slope, exact, atol=2e-3 * np.abs(exact).max())


def test_cop_satisfies_newton_and_euler(reference: PlanReference, plan: Plan) -> None:
    target = reference.at(inner_times())
    mass, g = plan.problem.mass, np.array((0.0, 0.0, plan.problem.gravity))
    force = mass * (target.com_acceleration + g)
    found = centre_of_pressure(target.com, force, target.momentum_rate[:, 3:])
    np.testing.assert_allclose(found, target.cop, atol=1e-9)
    np.testing.assert_allclose(target.momentum[:, :3], mass * target.com_velocity, rtol=1e-12)


def test_flight_is_ballistic_and_its_cop_moves_to_the_landing(hop: Plan, start: Snapshot) -> None:
    reference = PlanReference(hop, start, flights=True)
    off, fly, _ = hop.durations
    away, back = off + STEP, off + fly - STEP  # within the flight
    inside = np.linspace(away, back, 9)
    target = reference.at(inside)
    g = np.array((0.0, 0.0, -hop.problem.gravity))
    np.testing.assert_allclose(target.com_acceleration, np.tile(g, (9, 1)), atol=1e-9)
    t = inside[:, None] - away
    thrown = target.com[0] + t * target.com_velocity[0] + 0.5 * t**2 * g
    # Straight lines between samples: g/8 of their distance squared.
    np.testing.assert_allclose(target.com, thrown, atol=2e-6)
    cop = reference.at(np.array((off - STEP, off + fly + STEP))).cop
    part = (inside - off) / fly
    np.testing.assert_allclose(
        target.cop, (1.0 - part[:, None]) * cop[0] + part[:, None] * cop[1], atol=1e-3
    )


def test_a_plan_that_is_all_flight_has_its_cop_below_the_com(
    own: RobotPendulum, start: Snapshot
) -> None:
    """It was interpolated between no places: a ValueError."""
    up, down = (replace(own.rest, com_velocity=(0.0, 0.0, v)) for v in (0.5, -0.5))
    fly = PlanPhase("fly", 2.0 * 0.5 / own.pendulum.gravity, None, 6)
    plan = solve(crouching(own, start=up, goal=down, schedule=(fly,)))
    target = PlanReference(plan, start, flights=True).at(0.05)
    np.testing.assert_allclose(target.cop, (*target.com[:2], 0.0), atol=1e-9)


def test_targets_begin_at_the_standing_robot(reference: PlanReference, start: Snapshot) -> None:
    first = reference.at(BEGINS)
    np.testing.assert_allclose(first.com, start.com, atol=1e-8)
    np.testing.assert_allclose(first.inertia, vech(start.inertia), atol=1e-8)


def test_targets_are_at_rest_before_and_after_the_plan(
    reference: PlanReference, start: Snapshot
) -> None:
    assert reference.ends == pytest.approx(BEGINS + 0.8)
    inside = reference.at(BEGINS + 0.2)
    assert np.linalg.norm(inside.com_velocity) > 1e-3
    before, after, end = reference.at(0.0), reference.at(5.0), reference.at(reference.ends)
    np.testing.assert_array_equal(before.com, start.com)
    np.testing.assert_array_equal(before.cop, (*start.com[:2], 0.0))
    np.testing.assert_array_equal(before.inertia, vech(start.inertia))
    for name in ("com", "cop", "inertia"):
        np.testing.assert_array_equal(getattr(after, name), getattr(end, name))
    for target in (before, after):
        for name in ("com_velocity", "com_acceleration", "momentum", "momentum_rate",
                     "inertia_rate", "inertia_acceleration"):  # fmt: skip
            assert not getattr(target, name).any()


def test_targets_at_many_times_are_those_at_each(reference: PlanReference) -> None:
    times = np.array((0.1, BEGINS + 0.1234567, BEGINS + 0.8, 3.0))
    together = reference.at(times)
    for k, time in enumerate(times.tolist()):
        one = reference.at(time)
        np.testing.assert_array_equal(one.com, together.com[k])
        np.testing.assert_array_equal(one.inertia_rate, together.inertia_rate[k])


def test_bad_times_are_refused(reference: PlanReference, plan: Plan, start: Snapshot) -> None:
    with pytest.raises(InvalidInputError, match="time: NaN or infinite"):
        reference.at(float("nan"))
    with pytest.raises(InvalidInputError, match="begins"):
        PlanReference(plan, start, begins=-1.0)
