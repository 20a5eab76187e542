"""Weights of joints and thresholds of singular tasks in problem files."""

from pathlib import Path

import numpy as np
import pytest

from tests.problem.loading import problem_of
from wbc.errors import ProblemFileError

TEXT = """robot: g1_27
start: {posture: standing}
support: double
limits: none
controller: {method: METHOD, damping: 1e-6, joint_weights: {"*": 2, "*wrist*": 10, base: 100}}
tasks:
  com: {type: com, target: {offset: [0, 0, 0.1]}, ramp: 1.0, weight: 10, singular_threshold: 0.08}
  posture: {type: posture, target: start, weight: 0.01, gain: 0.1, singular_threshold: 0.001}
  still: {type: momentum, weight: 1e-4, singular_threshold: 0.01}
stop: {duration: 1.5, speed: null}
"""


def load(tmp_path: Path, text: str, **overrides):
    return problem_of(tmp_path, text, overrides)


@pytest.mark.parametrize("method", ["qp", "pseudo_inverse"])
def test_both_reach_the_controller(tmp_path: Path, method: str) -> None:
    loaded = load(tmp_path, TEXT.replace("METHOD", method))
    parts, start = loaded.parts, loaded.parts.robot.snapshot(loaded.parts.start)
    controller = parts.controller(loaded.spec.controller, parts.tasks, parts.contacts, start)
    names = parts.robot.joint_names
    expected = [100.0] * 6 + [10.0 if "wrist" in name else 2.0 for name in names]
    np.testing.assert_array_equal(controller.joint_weights, expected)
    assert [task.singular_threshold for task in parts.tasks] == [0.08, 0.001, 0.01]
    assert controller.step(start).singular.keys() == {"com", "posture", "still"}


def test_joints_do_not_race_towards_a_height_out_of_reach(tmp_path: Path) -> None:
    """A plain text without joint weights; the only difference between the runs is the threshold."""
    text = TEXT.replace("METHOD", "qp").replace(", singular_threshold: 0.001", "")
    text = text.replace('joint_weights: {"*": 2, "*wrist*": 10, base: 100}', "dt: 0.005")
    text = text.replace("  still: {type: momentum, weight: 1e-4, singular_threshold: 0.01}\n", "")
    fastest = {}
    for least in (0.0, 0.08):
        result = load(tmp_path, text, **{"tasks.com.singular_threshold": least}).run()
        assert not result.failures
        fastest[least] = np.abs(result.history.v[:, 6:]).max()
    assert fastest[0.08] < 0.5 * fastest[0.0]


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("controller.joint_weights", {"*wirst*": 2}, "unknown joint '*wirst*'"),
        ("controller.joint_weights", {"base": 0}, "greater than 0"),
        ("tasks.com.singular_threshold", -0.1, "must be at least 0"),
        ("tasks.still.singular_threshold", "small", "number"),
    ],
)
def test_mistakes_have_their_lines(tmp_path: Path, key: str, value: object, said: str) -> None:
    with pytest.raises(ProblemFileError) as caught:
        load(tmp_path, TEXT.replace("METHOD", "qp"), **{key: value})
    assert said in str(caught.value)
    assert key in str(caught.value)


def test_an_unknown_joint_is_named_with_its_line(tmp_path: Path) -> None:
    text = TEXT.replace("METHOD", "qp").replace("*wrist*", "left_wirst_yaw_joint")
    with pytest.raises(ProblemFileError) as caught:
        load(tmp_path, text)
    assert "did you mean 'left_wrist_yaw_joint'" in str(caught.value)
    assert "p.yaml:5: controller.joint_weights" in str(caught.value)
