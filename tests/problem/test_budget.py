"""What a file says of the budget of work reaches the controller."""

from pathlib import Path

import numpy as np
import pytest

from wbc.errors import ProblemFileError
from wbc.problem import load_problem

TEXT = """
robot: hoap2_like
support: double
tasks:
  com: {{type: com, target: {{offset: [0, 0, -0.01]}}}}
  posture: {{type: posture, target: start, priority: 1}}
controller: {{{}}}
stop: {{duration: 0.05, speed: null}}
"""


def load(folder: Path, controller: str):
    path = folder / "p.yaml"
    path.write_text(TEXT.format(controller))
    return load_problem(path)


@pytest.mark.parametrize(
    ("said", "units"), [("", 2400.0), ("budget: null", np.inf), ("budget: 1", 1.0)]
)
def test_a_budget_is_told_and_what_it_leaves_out(tmp_path: Path, said: str, units: float) -> None:
    problem = load(tmp_path, said)
    parts = problem.parts
    start = parts.robot.snapshot(parts.start)
    controller = parts.controller(problem.spec.controller, parts.tasks, parts.contacts, start)
    assert controller.budget == units
    left_out = problem.run().left_out
    assert left_out == ({"level 1: posture": 10} if units == 1.0 else {})


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ("budget: much", r"'much' does not exist \(choose from: usual\)"),
        ("budget: [1]", "expected a number, usual, or null"),
        ("budget: -1", "budget: .*greater than 0"),
        ("level: torque, budget: 100", "controller.budget: belongs to the velocity level"),
    ],
)
def test_what_is_no_budget(tmp_path: Path, said: str, words: str) -> None:
    with pytest.raises(ProblemFileError, match=words):
        load(tmp_path, said)
