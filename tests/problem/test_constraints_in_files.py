"""Constraints in problem files: each holds in the run, and mistakes are answered at their lines."""

from pathlib import Path

import numpy as np
import pytest

from tests.problem.loading import problem_of
from wbc.errors import ProblemFileError
from wbc.polygon import polygon_margin
from wbc.problem import load_problem
from wbc.reduction import support_polygon
from wbc.run import RunStatus

BOX = "type: box, frame: base, lower: [-9, -9, -9]"
# The base asked to sink.
SINK = {"type": "frame", "frame": "base", "control": "position", "gain": 0.1,
        "target": {"offset": [0.0, 0.0, -0.08]}}  # fmt: skip
BASE = """# A small robot, pulled about.
robot: hoap2_like
start: {posture: standing}
support: double
tasks:
  com: {type: com, target: {offset: [0.0, 0.0, 0.0]}, gain: 0.1}
  posture: {type: posture, target: start, weight: 0.01, gain: 0.1}
constraints:
  one: {type: box, frame: base, lower: [-9, -9, -9]}
stop: {duration: 1.5, speed: null}
"""


def problem(tmp_path: Path, text: str, **overrides):
    return problem_of(tmp_path, text, overrides)


def test_a_box_holds_the_base_up(tmp_path: Path) -> None:
    loaded = problem(tmp_path, BASE, **{"tasks.com": SINK})
    height = float(loaded.parts.start[2])
    free = loaded.run()
    lower = [None, None, height - 0.02]
    boxed = problem(
        tmp_path, BASE,
        **{"tasks.com": SINK, "constraints.one.lower": lower},
    ).run()  # fmt: skip
    assert free.q[2] < height - 0.04
    assert boxed.history.q[:, 2].min() > height - 0.02 - 1e-6
    assert boxed.q[2] < height - 0.019
    assert not boxed.failures


def test_a_trunk_that_is_asked_to_bow_stops_at_its_tilt(tmp_path: Path) -> None:
    bow = {"type": "frame", "frame": "base", "control": "orientation", "gain": 0.2,
           "target": {"rpy": [0.0, 0.6, 0.0]}}  # fmt: skip
    tilt = BASE.replace(f"{{{BOX}}}", "{type: tilt, angle: 0.25}")
    bowed = problem(tmp_path, BASE, **{"tasks.com": bow}).run()
    kept = problem(tmp_path, tilt, **{"tasks.com": bow}).run()
    assert _tilt(bowed.q) > 0.4
    assert max(map(_tilt, kept.history.q)) <= 0.25
    assert _tilt(kept.q) == pytest.approx(0.25, abs=2e-3)
    assert not kept.failures


def _tilt(q: np.ndarray) -> float:
    """Return the angle [rad] between the base's z axis and the vertical."""
    return float(np.arccos(1.0 - 2.0 * (q[3] ** 2 + q[4] ** 2)))


def test_the_com_stays_over_the_feet_that_stand_phase_by_phase(tmp_path: Path) -> None:
    text = BASE.replace(f"{{{BOX}}}", "{type: com_support, margin: 0.01}")
    text = text.replace("stop: {duration: 1.5, speed: null}", "")
    text += "phases:\n  both: {duration: 1.0}\n  left: {duration: 1.0, support: left}\n"
    text += (
        "  again: {duration: 0.5, support: left, tasks: {com: {target: {offset: [0, -0.2, 0]}}}}\n"
    )
    text = text.replace("offset: [0.0, 0.0, 0.0]", "over: left")
    result = problem(tmp_path, text).run()
    robot, history = result.robot, result.history
    assert not result.failures
    for q, support in zip(history.q[::20], history.support[::20], strict=True):
        snapshot = robot.snapshot(q)
        polygon = support_polygon(snapshot, str(support).split(","))
        # Inside by the margin; the CoM is on its way there in no phase.
        assert polygon_margin(polygon, snapshot.com[:2]) > 0.01 - 1e-6
    assert "left" in set(history.support.tolist())


@pytest.mark.slow
def test_a_moving_obstacle_pushes_the_hand_away_and_starts_anew_each_run(tmp_path: Path) -> None:
    text = BASE.replace(
        f"{{{BOX}}}",
        "{type: obstacles, links: ['*hand*', '*arm*'], margin: 0.01, things: {ball: "
        "{sphere: 0.03, position: [0.25, 0.16, 0.2], velocity: [-0.15, 0, 0]}}}",
    )
    loaded = problem(tmp_path, text)
    first, second = loaded.run(), loaded.run()
    np.testing.assert_allclose(first.history.q, second.history.q, atol=1e-9)
    still = problem(tmp_path, text, **{"constraints.one.things.ball.velocity": [0, 0, 0]}).run()
    hand = [r.robot.snapshot(r.q).position("left_hand") for r in (first, still)]
    assert np.linalg.norm(hand[0] - hand[1]) > 0.01
    # The ball's middle is never nearer to the hand's frame than its radius.
    for time, q in zip(first.history.time[::20], first.history.q[::20], strict=True):
        ball = np.array((0.25 - 0.15 * time, 0.16, 0.2))
        assert np.linalg.norm(first.robot.snapshot(q).position("left_hand") - ball) > 0.03
    assert not first.failures


def test_a_pseudo_inverse_takes_soft_constraints_only(tmp_path: Path) -> None:
    baseline = {"controller": {"method": "pseudo_inverse"}}
    with pytest.raises(ProblemFileError, match=r"constraints.one: a pseudo-inverse keeps"):
        problem(tmp_path, BASE, **baseline)
    problem(tmp_path, BASE, **baseline, **{"constraints.one.slack": 1.0})


def test_a_robot_at_rest_waits_for_an_obstacle_that_comes(tmp_path: Path) -> None:
    ball = "sphere: 0.05, position: [0.6, 0, 0.45], velocity: [-0.2, 0, 0]"
    text = BASE.replace(BOX, f"type: obstacles, things: {{ball: {{{ball}}}}}")
    text = text.replace("{duration: 1.5, speed: null}", "{duration: 0.5}")
    result = problem(tmp_path, text).run()
    assert (result.status, len(result.history)) == (RunStatus.COMPLETED, 100)
    with pytest.raises(ProblemFileError, match=r"stop.speed: obstacles move, so that the whole"):
        problem(tmp_path, text, **{"stop.speed": 1e-4})


def test_a_soft_box_gives_way(tmp_path: Path) -> None:
    pulled = {"tasks.com": SINK}
    height = float(problem(tmp_path, BASE).parts.start[2])
    lower = {"constraints.one.lower": [None, None, height - 0.02]}
    soft = problem(tmp_path, BASE, **pulled, **lower, **{"constraints.one.slack": 0.1}).run()
    assert soft.q[2] < height - 0.025
    contact = problem(
        tmp_path, BASE.replace("support: double", "support: [{frame: left_sole, slack: 0.01},"
                               " right_sole]"), **pulled,
    ).run()  # fmt: skip
    assert contact.slip is not None and contact.slip.where == "left_sole"
    assert contact.slip.value > 1e-3


# What is written, what replaces it, and what the message says.
MISTAKES = {
    "unknown type": ("type: box", "type: bix", "type: 'bix' does not exist; did you mean 'box'"),
    "unknown frame": ("frame: base", "frame: bsae", "p.yaml:9: constraints.one.frame: unknown"),
    "no bound": ("frame: base, lower: [-9, -9, -9]", "frame: left_hand", "no bound is finite"),
    "crossed": ("frame: base, lower: [-9, -9, -9]", "lower: [1, 1, 1], upper: [0, 0, 0]",
                "constraints.one"),
    "no shape": (BOX, "type: obstacles, things: {a: {position: [0, 0, 0]}}",
                 "constraints.one.things.a: needs one of sphere"),
    "two shapes": (BOX, "type: obstacles, things: {a: {sphere: 1, box: [1, 1,"
                   " 1]}}", "only one"),
    "unknown link": (BOX, "type: self_collision, exclude: [[hed, base]]",
                     "constraints.one.exclude"),
    "nothing left of what stands": (BOX, "type: com_support, margin: 0.5",
                                    "p.yaml:9: constraints.one: com support, margin"),
    "no polygon left": (BOX, "type: com_support, margin: 1.0, feet: [left]",
                        "leaves nothing"),
    "unknown foot": (BOX, "type: com_support, feet: [lleft]",
                     "did you mean 'left'"),
    "negative slack": ("frame: base", "frame: base, slack: -1", "constraints.one.slack"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes(name: str, tmp_path: Path) -> None:
    old, new, said = MISTAKES[name]
    with pytest.raises(ProblemFileError) as caught:
        problem(tmp_path, BASE.replace(old, new))
    assert said in str(caught.value)


@pytest.mark.slow
def test_the_problem_that_ships_keeps_every_margin() -> None:
    path = Path(__file__).parents[2] / "problems" / "safe_reach_g1.yaml"
    result = load_problem(path).run()
    assert result.status.good
    assert not result.failures
    robot = result.robot
    for q in result.history.q[::25]:
        snapshot = robot.snapshot(q)
        # The wall is at x = 0.4 m, its margin 2 cm: the wrist's own frame is behind that.
        assert snapshot.position("right_wrist_yaw_link")[0] < 0.38
        assert snapshot.position("pelvis")[2] > 0.6
    assert result.balance is not None and result.balance.value > 0.02
