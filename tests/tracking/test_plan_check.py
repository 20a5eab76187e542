"""Plans for another robot, place or soles are refused, with the numbers that do not fit."""

from dataclasses import replace

import pytest

from tests.tracking.conftest import FEET, crouching
from wbc import PlanMismatchError
from wbc.rmp.plan import Plan, PlanPhase, at_rest, rectangle, solve
from wbc.rmp.solid import SolidRmp
from wbc.robot import Snapshot
from wbc.tracking.pendulum import RobotPendulum
from wbc.tracking.plan_check import check_plan


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
