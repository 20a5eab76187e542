"""Postures of robots with mimic joints: what is named is met by both, or refused."""

from pathlib import Path

import numpy as np
import pytest

from tests import urdf
from tests.problem.loading import problem_of
from tests.robot.formats import mjcf_texts as mjcf
from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.tasks import PostureTask

GEARED = urdf.robot(
    "geared",
    *map(urdf.link, ("trunk", "upper", "lower", "tip")),
    urdf.joint("j1", "trunk", "upper"),
    urdf.joint("j3", "lower", "tip"),
    urdf.joint("j2", "upper", "lower", '<mimic joint="j1" multiplier="-2" offset="0.1"/>'),
)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.load(GEARED)


@pytest.mark.parametrize(
    ("given", "found"),
    [
        ({"j1": 0.3}, [0.3, -0.5, 0.0]),
        ({"j2": 0.3}, [-0.1, 0.3, 0.0]),  # before, 0.3 was dropped without a word
        ({"j1": 0.3, "j2": -0.5}, [0.3, -0.5, 0.0]),
        ({"j*": 0.2}, [0.2, -0.3, 0.2]),
        ({"j3": 0.5}, [0.0, 0.1, 0.5]),
    ],
)
def test_named_joint_of_a_gear_moves_the_other(
    robot: Robot, given: dict[str, float], found: list[float]
) -> None:
    np.testing.assert_allclose(robot.posture("neutral", given)[7:], found, atol=1e-9)


@pytest.mark.parametrize("given", [{"j1": 0.9}, {"j1": 0.3, "j2": 0.5}])
def test_gear_that_cannot_be_met_is_refused_by_name(robot: Robot, given: dict[str, float]) -> None:
    """At 0.9 the follower would have to be at -1.7, beyond its limit."""
    with pytest.raises(InvalidInputError, match="'j2' cannot follow 'j1' to -"):
        robot.posture("neutral", given)


@pytest.mark.parametrize(("joint", "found"), [("j1", [0.3, -0.5, 0.0]), ("j2", [-0.1, 0.3, 0.0])])
def test_posture_target_of_a_problem_names_either_end_of_a_gear(
    tmp_path: Path, joint: str, found: list[float]
) -> None:
    (tmp_path / "geared.urdf").write_text(GEARED)
    target = f"{{type: posture, target: {{{joint}: 0.3}}}}"
    (task,) = problem_of(tmp_path, f"robot: geared.urdf\ntasks: {{p: {target}}}\n").parts.tasks
    assert isinstance(task, PostureTask)
    np.testing.assert_allclose(task.target[7:], found, atol=1e-9)


@pytest.mark.parametrize(
    ("values", "set_to"),
    [
        ({"j1": 0.3, "j2": 0.5}, "j2 at -0.5, not 0.5"),
        ({"j2": -0.5}, "j2 at 0.1, not -0.5"),
        ({"j1": 0.3, "j2": -0.5002}, ""),  # rounded in the file
        ({"j1": 0.3}, ""),
    ],
)
def test_state_of_a_file_that_is_off_a_gear_is_noted(
    tmp_path: Path, values: dict[str, float], set_to: str
) -> None:
    joints = "".join(f'<joint name="{key}" value="{value}"/>' for key, value in values.items())
    file = tmp_path / "r.srdf"
    file.write_text(f'<robot name="r"><group_state name="bent">{joints}</group_state></robot>')
    notes = [note for note in Robot.load(GEARED, srdf=file).notes if "'bent'" in note]
    told = "posture 'bent': joints follow their drivers in place of the file's values: "
    assert notes == [told + set_to] * bool(set_to)


def test_key_frame_that_is_off_an_equality_constraint_is_noted() -> None:
    second = mjcf.arm(name="b").replace("j1", "j2")
    tail = '<equality><joint joint1="j2" joint2="j1" polycoef=".1 -2 0 0 0"/></equality>'
    tail += '<keyframe><key name="bent" qpos="0 0 1 1 0 0 0 .3 .5"/></keyframe>'
    robot = Robot.load(mjcf.text(mjcf.arm() + second, tail=tail))
    assert [note[-20:] for note in robot.notes if "'bent'" in note] == [" j2 at -0.5, not 0.5"]
