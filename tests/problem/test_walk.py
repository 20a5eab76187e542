"""Walks in problem files: what is made of them, mistakes with their places, and a short one."""

from pathlib import Path
from typing import Any

import pytest

from tests.problem.loading import complaint_of, problem_of
from wbc.errors import InvalidInputError
from wbc.gait import Walker
from wbc.problem import Problem
from wbc.problem.walk import walker_of
from wbc.problem.walk_spec import WalkSpec
from wbc.simulation import SimulationStatus

WALK = """\
robot: hoap2_like
gait:
  clearance: 0.02
  commands:
    - {at: 0.1, vx: 0.12}
    - {at: 0.9, vx: 5}
simulation: {duration: 1.2}
"""


def problem(folder: Path, text: str = WALK, overrides: dict[str, Any] | None = None) -> Problem:
    found = problem_of(folder, text, overrides)
    assert isinstance(found, Problem)
    return found


def walker_in(problem: Problem) -> Walker:
    assert isinstance(problem.spec, WalkSpec)
    return walker_of(problem.spec, problem.parts)


@pytest.mark.slow
def test_it_walks_and_says_what_was_beyond_the_legs(tmp_path: Path) -> None:
    one = problem(tmp_path)
    result = one.simulate()
    assert result.status is SimulationStatus.STOOD
    assert result.arrays["q"][-1, 0] - result.arrays["q"][0, 0] > 0.04
    assert [note for note in result.notes if "command at 0.9 s: (5, 0) m/s is beyond" in note]
    supports = set(result.run.history.support.tolist())
    assert {"left", "right"} <= supports and len(supports) >= 3
    assert result.relaxed < 0.01


def test_settings_arrive(tmp_path: Path) -> None:
    walker = walker_in(problem(tmp_path, overrides={"gait.weights": {"trunk": 2.0}}))
    assert walker.gait.clearance == 0.02
    names = {task.name: task for task in walker.controller.tasks}
    assert names["base"].weight.tolist() == [2.0] * 3


def test_other_tasks_come_along(tmp_path: Path) -> None:
    text = WALK + "tasks:\n  arms: {type: posture, weight: 0.5, joints: {'*elbow*': 1}}\n"
    assert "arms" in {task.name for task in walker_in(problem(tmp_path, text)).lasting_tasks}


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ({"gait.single": 0}, "gait.single: must be greater than 0, got 0"),
        ({"gait.height": 0.4}, "legs do not reach the ground"),
        ({"gait.ramp": 0.3}, "ramp: 0.3 s is longer than the double support"),
        ({"gait.commands": []}, "gait.commands: empty; it needs at least one entry"),
        ({"gait.commands": [{"at": 0.5}, {"at": 0.5}]}, "commands[1].at: comes after the one at"),
        ({"gait.commands": [{"at": 9}]}, "is given after the end of the simulation (1.2 s)"),
        ({"gait.commands": [{"at": 0, "vz": 1}]}, "did you mean 'vy'"),
        ({"gait.weights": {"trunk": 0}}, "walking weights, trunk: must be greater than 0"),
        ({"support": "left"}, "support: 'left' does not exist"),
        (
            {"robot": {"model": "hoap2_like", "feet": {}}},
            "no feet were found",
        ),
    ],
)
def test_mistakes(tmp_path: Path, overrides: dict[str, Any], said: str) -> None:
    assert said in complaint_of(tmp_path, WALK, overrides)


def test_a_walk_is_not_run(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="wbc sim"):
        problem(tmp_path).run()
