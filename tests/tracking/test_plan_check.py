"""Plans of a robot as a pendulum: what does not fit is refused, and how far a motion is off."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracking.conftest import FEET, crouching
from wbc import PlanMismatchError
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.polygon import polygon_margin
from wbc.rmp.plan import Plan, PlanPhase, at_rest, rectangle, solve
from wbc.rmp.solid import SolidRmp
from wbc.robot import Robot, Snapshot
from wbc.rotations import rotation_from
from wbc.tracking.deviation import Deviation, evaluate_tracking
from wbc.tracking.pendulum import RobotPendulum, pendulum_of
from wbc.tracking.plan_check import check_plan
from wbc.tracking.reference import PlanReference


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


def test_flights_and_supports_of_other_feet_are_refused(
    plan: Plan, start: Snapshot, hop: Plan
) -> None:
    with pytest.raises(PlanMismatchError, match="'fly' is a flight"):
        check_plan(hop, start, FEET)
    check_plan(hop, start, FEET, flights=True)
    with pytest.raises(PlanMismatchError, match=r"'down' has the CoP up to .* outside the soles"):
        check_plan(plan, start, ("left",))


def test_pendulum_has_mass_com_and_inertia_of_the_robot(
    start: Snapshot, own: RobotPendulum
) -> None:
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


def test_soles_with_margin_are_inside_the_standing_ones(
    start: Snapshot, own: RobotPendulum
) -> None:
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


def test_deviation_of_a_robot_at_rest_is_the_motion_of_the_plan(
    plan: Plan, start: Snapshot
) -> None:
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
