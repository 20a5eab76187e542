"""A scheduled walk waits where it begins until its first tick."""

from pathlib import Path

import pytest

from wbc.gait.phases import Standing
from wbc.problem import load_problem
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
