"""A humanoid, and a plan made from its own pendulum."""

from dataclasses import replace
from functools import cache

import pytest

from wbc.rmp.plan import PathLimits, Plan, PlanPhase, PlanProblem, State, solve
from wbc.robot import Robot, Snapshot
from wbc.tracking.pendulum import RobotPendulum, pendulum_of

FEET = ("left", "right")


@cache
def standing() -> Snapshot:
    robot = Robot.load("hoap2_like")
    return robot.snapshot(robot.posture("standing"))


@pytest.fixture
def start() -> Snapshot:
    return standing()


@pytest.fixture
def own(start: Snapshot) -> RobotPendulum:
    return pendulum_of(start)


def crouching(own: RobotPendulum, margin: float = 0.005, **changes: object) -> PlanProblem:
    """A crouch by 1 cm that turns about y and makes itself small: everything moves."""
    soles = own.soles(FEET, margin)
    x, y, z = own.rest.com
    small = [0.98 * r for r in own.rest.radii]
    crouched = State(com=(x, y, z - 0.01), rotation=(0.0, 0.03, 0.0), radii=small)
    problem = {
        "pendulum": own.pendulum,
        "start": own.rest,
        "goal": own.rest,
        "schedule": (
            PlanPhase("down", 0.4, soles, 6, end=crouched),
            PlanPhase("up", 0.4, soles, 6),
        ),
        "nominal": own.rest,
        "limits": PathLimits(friction=0.5, torsion=0.02, normal_force=(5.0, 200.0)),
        "reference": own.reference,
    }
    return PlanProblem(**(problem | changes))


@cache
def crouch() -> Plan:
    return solve(crouching(pendulum_of(standing())))


@pytest.fixture
def plan() -> Plan:
    return crouch()


@cache
def hopping() -> Plan:
    own = pendulum_of(standing())
    soles = own.soles(FEET)
    schedule = (
        PlanPhase("off", 0.3, soles, 6),
        PlanPhase("fly", (0.02, 0.1), None, 3),
        PlanPhase("land", 0.3, soles, 6),
    )
    return solve(crouching(own, schedule=schedule, goal=replace(own.rest, momentum=None)))


@pytest.fixture
def hop() -> Plan:
    return hopping()
