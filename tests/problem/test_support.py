"""What a file says the robot stands on: feet by words, by their names, and frames."""

from pathlib import Path

import numpy as np
import pytest

from tests.problem.loading import problem_of
from wbc.errors import ProblemFileError
from wbc.problem import Problem
from wbc.run.phase_support import held_feet
from wbc.simulation import capture_impulse

TEXT = """
robot: {robot}
support: {support}
tasks:
  com: {{type: com, target: {{over: {over}}}}}
  posture: {{type: posture, target: start, weight: 0.1}}
"""


def load(folder: Path, robot: str, support: str, over: str) -> Problem:
    return problem_of(folder, TEXT.format(robot=robot, support=support, over=over))


@pytest.fixture
def quadruped(g1) -> str:
    folder = next(p for p in g1.path.parents if p.name == "robots")
    return str(folder / "go2_description/urdf/go2.urdf")


def test_a_quadruped_stands_on_all_feet_with_its_com_over_them(tmp_path: Path, quadruped) -> None:
    parts = load(tmp_path, quadruped, "all", "all").parts
    soles = [foot.frame for foot in parts.robot.feet.values()]
    assert [contact.frame for contact in parts.contacts] == soles
    assert len(soles) == 4
    start = parts.robot.snapshot(parts.start)
    middle = np.mean([start.position(sole) for sole in soles], axis=0)
    (com,) = (one for one in parts.targeted if one.task.name == "com")
    np.testing.assert_allclose(com.goal(start, start.com)[:2], middle[:2], atol=1e-12)


def test_feet_that_are_points_count_for_pushes_and_balance(tmp_path: Path, quadruped) -> None:
    """By hand: d of M omega d is as far as the line between the front feet is ahead of the CoM."""
    parts = load(tmp_path, quadruped, "all", "all").parts
    feet, start = held_feet(parts.contacts), parts.at_start
    assert sorted(feet) == ["front_left", "front_right", "hind_left", "hind_right"]
    soles = np.array([start.position(parts.robot.feet[foot].frame) for foot in feet])
    height = start.com[2] - soles[:, 2].mean()
    front = soles[[feet.index(f"front_{side}") for side in ("right", "left")]]
    d = np.interp(start.com[1], front[:, 1], front[:, 0]) - start.com[0]
    caught = parts.robot.mass * np.sqrt(parts.robot.gravity / height) * d
    assert capture_impulse(start, feet, (1.0, 0.0)) == pytest.approx(caught, rel=1e-6)


def test_feet_are_listed_by_their_names_beside_frames(tmp_path: Path) -> None:
    support = "[{frame: left, slack: 100}, right_hand]"
    parts = load(tmp_path, "hoap2_like", support, "double").parts
    assert [contact.frame for contact in parts.contacts] == ["left_sole", "right_hand"]
    assert parts.contact_slack == {"left_sole": 100.0}


@pytest.mark.parametrize(
    ("support", "over", "words"),
    [
        ("double", "all", "its feet are front_left, front_right, hind_left, hind_right; write all"),
        ("all", "double", "unknown foot of go2_description 'double'"),
        ("[front_left, front_left_sole]", "all", "frame 'front_left_sole' is named twice"),
    ],
)
def test_words_that_do_not_fit(tmp_path, quadruped, support, over, words) -> None:
    with pytest.raises(ProblemFileError, match=words):
        load(tmp_path, quadruped, support, over)


@pytest.mark.parametrize(("on_ground", "height"), [(True, -0.3), (False, 0.0)])
def test_what_stands_on_its_back_may_stay_where_its_posture_has_it(
    tmp_path: Path, quadruped, caplog: pytest.LogCaptureFixture, on_ground: bool, height: float
) -> None:
    """Soles on the ground put the rest of a robot whose legs point up below it, in silence."""
    start = {"start.joints": {"*_thigh_joint": 3.0}, "start.on_ground": on_ground}
    text = TEXT.format(robot=quadruped, support="[{frame: FL_thigh, type: point}]", over="all")
    parts = problem_of(tmp_path, text, {**start, "start.posture": "neutral"}).parts
    z = parts.robot.snapshot(parts.start).position("FL_thigh")[2]
    assert z < height if on_ground else z == pytest.approx(height, abs=1e-12)
    told = "support: FL_thigh begins"
    assert (told in caplog.text and "start: {on_ground: false}" in caplog.text) is on_ground
