"""What the robot section of a file says of the joints' drives reaches the model."""

from pathlib import Path

import numpy as np
import pytest

from tests.problem.loading import problem_of
from wbc.errors import ProblemFileError

TEXT = """
robot: {{model: hoap2_like, {0}}}
support: double
tasks:
  posture: {{type: posture, target: start}}
"""


def load(folder: Path, section: str):
    return problem_of(folder, TEXT.format(section)).parts.robot


def test_drives_are_numbers_or_by_joint(tmp_path: Path) -> None:
    section = 'armature: 0.01, damping: {"*": 0.1, "*_knee_*": 0.4}, friction: 0, '
    robot = load(tmp_path, section + "effort: {waist_pitch: 20}")
    knees = np.array(["_knee_" in name for name in robot.joint_names])
    assert knees.sum() == 2
    np.testing.assert_array_equal(robot.armature, 0.01)
    np.testing.assert_array_equal(robot.damping, np.where(knees, 0.4, 0.1))
    np.testing.assert_array_equal(robot.friction, 0.0)
    waist = np.array([name == "waist_pitch" for name in robot.joint_names])
    np.testing.assert_array_equal(robot.limits.effort, np.where(waist, 20.0, 9.0))


@pytest.mark.parametrize(
    ("section", "told"),
    [
        ("effort: 0", "robot.effort"),
        ("armature: -1", "robot.armature"),
        ("damping: [1, 2]", "expected a number, or {joint or pattern: number}"),
        ("friction: {wiast_pitch: 1}", "wiast_pitch"),
    ],
)
def test_mistakes_have_their_key(tmp_path: Path, section: str, told: str) -> None:
    with pytest.raises(ProblemFileError) as caught:
        load(tmp_path, section)
    assert told in str(caught.value)
    assert "p.yaml:2" in str(caught.value)
