"""A plan as targets over time, against differences and Newton and Euler; what does not fit."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracking.conftest import FEET, crouching
from wbc import PlanMismatchError
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.polygon import polygon_margin
from wbc.rmp.ground import centre_of_pressure
from wbc.rmp.plan import Plan, PlanPhase, at_rest, rectangle, solve
from wbc.rmp.solid import SolidRmp
from wbc.robot import Robot, Snapshot
from wbc.rotations import rotation_from
from wbc.spatial import vech
from wbc.tracking.deviation import Deviation, evaluate_tracking
from wbc.tracking.pendulum import RobotPendulum, pendulum_of
from wbc.tracking.plan_check import check_plan
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
def test_rates_are_derivatives_of_the_values(reference, value, rate) -> None:
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


def test_a_plan_that_is_all_flight_has_its_cop_below_the_com(own, start) -> None:
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


def test_targets_are_at_rest_before_and_after_the_plan(reference, start) -> None:
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


def test_plan_of_the_own_pendulum_is_accepted(plan: Plan, start: Snapshot) -> None:
    check_plan(plan, start, FEET)


def test_mismatches_are_all_named(start: Snapshot, own: RobotPendulum) -> None:
    x, y, z = own.rest.com
    other = solve(
        crouching(
            own,
            pendulum=SolidRmp(2.0 * own.pendulum.mass, 1.62),
            start=at_rest((x, y, z + 0.1), (0.2, 0.2, 0.2)),
            goal=own.rest,
            schedule=(PlanPhase("stand", 0.5, rectangle(0.0, 0.0, 0.4, 0.4), 4),),
        )
    )
    with pytest.raises(PlanMismatchError) as caught:
        check_plan(other, start, FEET)
    told = str(caught.value)
    mass = start.robot.mass
    assert f"mass is {2 * mass:.4g} kg, the robot's {mass:.4g}" in told
    assert "gravity is 1.62 m/s^2, the robot's 9.81" in told
    assert "100 mm from the robot's" in told
    assert "principal moments of inertia begin at" in told
    assert "phase 'stand' has the CoP up to" in told and "mm outside the soles" in told
    assert "wbc.pendulum_of" in told


def test_a_plan_that_begins_turned_is_refused(start: Snapshot, own: RobotPendulum) -> None:
    """Only the moments were compared, which are the same."""
    turned = replace(own.rest, rotation=(0.0, 0.5, 0.0))
    with pytest.raises(PlanMismatchError, match="principal axes of inertia begin turned") as caught:
        check_plan(solve(crouching(own, start=turned)), start, FEET)
    assert ";" not in str(caught.value).split("; plan with")[0]  # nothing else is wrong


def test_flights_and_supports_of_other_feet_are_refused(plan, start, hop) -> None:
    with pytest.raises(PlanMismatchError, match="'fly' is a flight"):
        check_plan(hop, start, FEET)
    check_plan(hop, start, FEET, flights=True)
    with pytest.raises(PlanMismatchError, match=r"'down' has the CoP up to .* outside the soles"):
        check_plan(plan, start, ("left",))


def test_pendulum_has_mass_com_and_inertia_of_the_robot(start, own) -> None:
    assert own.pendulum.mass == start.robot.mass
    assert own.pendulum.gravity == pytest.approx(9.81)
    np.testing.assert_array_equal(own.rest.com, start.com)
    assert own.rest.com_velocity == own.rest.momentum == own.rest.rotation == (0.0, 0.0, 0.0)
    # Six masses M/6 at +-r_k e_k, summed one by one: rounding of an eigen-decomposition.
    R, inertia = rotation_from(np.array(own.reference)), np.zeros((3, 3))
    for axis, radius in zip(R.T, own.rest.radii, strict=True):
        for place in (radius * axis, -radius * axis):
            inertia += (
                own.pendulum.mass / 6.0 * (place @ place * np.eye(3) - np.outer(place, place))
            )
    np.testing.assert_allclose(inertia, start.inertia, rtol=1e-9, atol=1e-12)


def test_axes_are_named_after_the_nearest_world_axes(own: RobotPendulum) -> None:
    R = rotation_from(np.array(own.reference))
    assert (np.abs(R).argmax(axis=0) == [0, 1, 2]).all() and (np.diag(R) > 0.9).all()
    # Of a standing humanoid the vertical pair is the longest.
    assert np.argmax(own.rest.radii) == 2


def test_soles_with_margin_are_inside_the_standing_ones(start, own) -> None:
    whole = np.array(own.soles(("left", "right")))
    inner = np.array(own.soles(("left", "right"), 0.01))
    assert polygon_margin(whole, inner).min() == pytest.approx(0.01, abs=1e-9)
    left = np.array(own.soles(("left",)))
    np.testing.assert_array_equal(own.soles("left"), left)  # as PlanReference takes it; it was 'l'
    assert polygon_margin(whole, left).min() >= -1e-12
    assert left[:, 1].mean() > 0.0 > start.position(start.robot.foot("right").frame)[1]
    with pytest.raises(UnknownNameError, match=r"'lfet'.*'left'"):
        own.soles(("lfet",))
    with pytest.raises(InvalidInputError, match="nothing of it is 1 m inside"):
        own.soles(("left",), 1.0)


def test_soles_in_the_air_are_refused(own: RobotPendulum) -> None:
    robot: Robot = own.start.robot
    q = own.start.q.copy()
    q[2] += 0.02
    with pytest.raises(InvalidInputError, match=r"left foot is at z = 0\.02 m"):
        pendulum_of(robot.snapshot(q)).soles(("left", "right"))


def test_deviation_has_rms_largest_error_and_its_time() -> None:
    time = np.array((0.0, 1.0, 2.0, 3.0))
    actual = np.array(((0.0, 0.0), (3.0, 4.0), (np.nan, 0.0), (0.0, 1.0)))
    found = Deviation.of(time, actual, np.zeros((4, 2)), 10.0)
    assert found == Deviation(pytest.approx(np.sqrt(26.0 / 3.0)), 5.0, 1.0, 10.0)
    nothing = Deviation.of(time, np.full((4, 2), np.nan), np.zeros((4, 2)), 10.0)
    assert np.isnan([nothing.rms, nothing.worst, nothing.at]).all()


def test_deviation_of_a_robot_at_rest_is_the_motion_of_the_plan(plan, start) -> None:
    reference = PlanReference(plan, start, begins=0.1)
    time = np.arange(0.0, 1.2, 0.01)
    n = len(time)
    shift = np.array((0.003, 0.004, 0.0))
    truth = {
        "time": time,
        "q": np.tile(start.q, (n, 1)),
        "v": np.zeros((n, start.robot.nv)),
        "cop": reference.at(time).cop + shift,
    }
    found = evaluate_tracking(reference, start.robot, truth)
    assert found.cop.rms == pytest.approx(0.005) == found.cop.worst
    # The crouch is 1 cm deep halfway.
    assert found.com.worst == pytest.approx(found.com.peak, rel=1e-3)
    assert found.com.at == pytest.approx(0.5, abs=0.011) and 0.01 <= found.com.worst < 0.02
    most = np.linalg.norm(plan.refined(8).momentum, axis=1).max()
    assert found.momentum.peak == pytest.approx(most, rel=1e-2)
    assert found.momentum.worst == pytest.approx(most, rel=1e-2)
    assert found.inertia.worst == pytest.approx(found.inertia.peak, rel=1e-3)
    assert found.whole and (found.begins, found.until) == (0.1, reference.ends)
    np.testing.assert_array_equal(found.arrays["plan_com"], reference.at(time).com)
    early = evaluate_tracking(
        reference, start.robot, {name: rows[:50] for name, rows in truth.items()}
    )
    assert not early.whole and early.until == pytest.approx(0.49)
    assert early.summary()["ends"] == reference.ends
