"""A scheduled walk waits where it begins until its first tick, and says how far it came."""

import math
from pathlib import Path

import pytest

from wbc.gait import Velocity, Walker
from wbc.gait.phases import Standing
from wbc.gait.scheduled_walk import ScheduledWalk, TimedCommand, describe_way
from wbc.problem import load_problem
from wbc.robot import Robot
from wbc.run.supervisor import BEFORE_START

PROBLEMS = Path(__file__).parents[2] / "problems"


@pytest.mark.parametrize("name", ["walk_g1", "footsteps_g1"])
def test_a_robot_that_waits_makes_no_step(name: str) -> None:
    problem = load_problem(PROBLEMS / f"{name}.yaml")
    walk, start = problem.supervisor_on_robot(), problem.parts.at_start
    steps = round(3.0 / walk.controller.dt)
    for _ in range(steps):
        walk.update(BEFORE_START, start)
        assert isinstance(walk.walker.phase, Standing)
    phases = set()
    for tick in range(steps):
        walk.update(tick, start)
        phases.add(type(walk.walker.phase))
    assert phases - {Standing}


def test_distance_from_where_the_commands_lead_is_in_the_robots_axes(hoap2: Robot) -> None:
    walker = Walker(hoap2)
    walker.heading = 0.5 * math.pi
    told = describe_way(0.1 - 0.3j, walker)  # to the east and south of it, facing north
    assert (
        told == "commands: after 0 steps 0.30 m behind and 0.10 m to the right of where their"
        " speeds lead"
    )


def test_way_of_a_walk_is_the_integral_of_its_speeds(hoap2: Robot) -> None:
    """On a robot that never moves, after speeding up at the gait's acceleration."""
    walker, start = Walker(hoap2, dt=0.01), hoap2.snapshot(hoap2.posture("standing"))
    walk = ScheduledWalk(walker, [TimedCommand(0.5, Velocity(0.05))])
    for tick in range(200):
        walk.update(tick, start)
    ramp = 0.05 / walker.gait.acceleration
    behind = 0.05 * (1.5 - 0.5 * ramp)
    assert f" {behind:.2f} m behind and 0.00 m to the " in walk.notes[-1]
