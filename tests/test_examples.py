"""Every example runs as it stands, and does what it says."""

import re
import runpy
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "examples"
README = (FOLDER / "README.md").read_text(encoding="utf-8")
NUMBER = r"(-?\d+(?:\.\d*)?(?:e[-+]?\d+)?)"


def outcome(name: str, capsys: pytest.CaptureFixture[str]) -> str:
    """Run an example as a user would, and return what it printed."""
    runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
    return capsys.readouterr().out


def number(text: str, pattern: str) -> float:
    """Return the number that stands for ``#`` in ``pattern``."""
    found = re.search(re.escape(pattern).replace(r"\#", NUMBER), text)
    assert found, f"{pattern!r} is not in {text!r}"
    return float(found.group(1))


def test_all_are_listed_and_tested() -> None:
    names = {path.stem for path in FOLDER.glob("*.py")}
    assert names == set(re.findall(r"^\| `(\w+)\.py` \|", README, flags=re.MULTILINE))
    assert names == {name[5:] for name in globals() if name.startswith("test_")} - {
        "all_are_listed_and_tested"
    }
    assert 10 <= len(names) <= 25
    for name in names:
        text = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
        assert text.startswith('"""') and 15 <= text.count("\n") <= 90, name


@pytest.mark.slow
def test_walk(capsys: pytest.CaptureFixture[str]) -> None:
    first, beyond, _, _, told, end = outcome("walk", capsys).splitlines()
    assert first.endswith("all of it") and "is beyond the" in beyond
    assert number(told, "stood for # s") > 3.99
    assert number(told, "# m ahead") > 0.2
    assert number(told, "turned # deg") > 10.0
    assert "Standing again" in end
    assert number(end, "; # of") == 0


def test_hand_target(capsys: pytest.CaptureFixture[str]) -> None:
    near, far = outcome("hand_target", capsys).splitlines()
    assert number(near, "near: hand misses by # mm") < 0.5
    assert number(far, "too far: hand misses by # mm") > 100.0
    assert number(far, "CoM # mm inside") >= 9.9  # of the 10 mm asked for
    assert "held by: com vs support edge" in far


def test_closed_loop(capsys: pytest.CaptureFixture[str]) -> None:
    text = outcome("closed_loop", capsys)
    assert number(text, "motor at # rad") == pytest.approx(-0.6, abs=1e-3)
    assert number(text, "open by # nm") < 0.1
    assert number(text, "and # N m elsewhere") == 0.0


def test_squat(capsys: pytest.CaptureFixture[str]) -> None:
    text = outcome("squat", capsys)
    assert number(text, "CoM down by # mm") == pytest.approx(30.0, abs=0.2)
    assert number(text, "worst error # mm") < 0.1
    assert number(text, "feet moved # mm") < 0.01


def test_follow_plan(capsys: pytest.CaptureFixture[str]) -> None:
    text = outcome("follow_plan", capsys)
    assert number(text, "CoM at most # mm from the plan") < 1.0
    assert number(text, "angular momentum at most # %") < 20.0


def test_own_task(capsys: pytest.CaptureFixture[str]) -> None:
    text = outcome("own_task", capsys)
    assert number(text, "Jacobian off by #;") < 1e-8
    assert number(text, "passes the point at # mm") < 1.0


def test_own_constraint(capsys: pytest.CaptureFixture[str]) -> None:
    text = outcome("own_constraint", capsys)
    assert 299.0 < number(text, "hands at most # mm apart") <= 300.0
    assert "('rope taut',)" in text


def test_own_robot(capsys: pytest.CaptureFixture[str]) -> None:
    text = outcome("own_robot", capsys)
    assert text.startswith("dog: 12 joints")
    assert number(text, "trunk off by # mm") < 0.5
    assert number(text, "feet moved # mm") < 0.01


def test_arm(capsys: pytest.CaptureFixture[str]) -> None:
    text = outcome("arm", capsys)
    assert number(text, "tool off the circle by # mm") < 0.1
    assert number(text, "base by # m") < 1e-9


def test_obstacles(capsys: pytest.CaptureFixture[str]) -> None:
    text = outcome("obstacles", capsys)
    assert number(text, "came as near as # mm") >= 20.0
    assert number(text, "hand off by # mm") > 20.0  # it went away for the ball


@pytest.mark.slow
def test_priorities(capsys: pytest.CaptureFixture[str]) -> None:
    shared, left, right = outcome("priorities", capsys).splitlines()
    assert number(shared, "one level: left misses by # mm") > 5.0
    assert number(shared, "right by # mm") > 5.0
    assert number(left, "left first: left misses by # mm") < 0.5
    assert number(left, "right by # mm") > 20.0
    assert number(right, "right first: left misses by # mm") > 20.0
    assert number(right, "right by # mm") < 0.5


def test_inertia_shaping(capsys: pytest.CaptureFixture[str]) -> None:
    text = outcome("inertia_shaping", capsys)
    assert number(text, "Izz times #,") == pytest.approx(1.5, abs=0.01)
    assert number(text, "CoM moved # mm") < 0.1
    assert text.count("semi-axes") == 2


def test_global_shaping(capsys: pytest.CaptureFixture[str]) -> None:
    text = outcome("global_shaping", capsys)
    start, alone = number(text, "start #,"), number(text, "QP alone #,")
    assert number(text, "global # kg m^2") < 0.7 * alone < 0.7 * start
    assert text.rstrip().endswith("arrived: True")


def test_problem_file(capsys: pytest.CaptureFixture[str]) -> None:
    slow, fast, files, mistake = outcome("problem_file", capsys).splitlines()
    for line in (slow, fast):
        assert ": converged after" in line
        assert number(line, "CoM off by # mm") < 1e-3
    assert number(fast, "after # ticks") < number(slow, "after # ticks")
    assert "result.npz" in files and "did you mean 'gain'" in mistake


def test_analyze_recording(capsys: pytest.CaptureFixture[str]) -> None:
    text = outcome("analyze_recording", capsys)
    assert number(text, "leg from #") > number(text, "to # m\n") + 0.05
    assert number(text, "CoP at least # mm inside") > 10.0


def test_recorded_human(capsys: pytest.CaptureFixture[str]) -> None:
    text = outcome("recorded_human", capsys)
    assert number(text, "kg): # mm") < 1.0
    # It bows and rises once in 1 s: the push is the weight, 686 N, but for some per cent.
    assert number(text, "push # N") == pytest.approx(686.0, rel=0.1)


def test_retarget(capsys: pytest.CaptureFixture[str]) -> None:
    text = outcome("retarget", capsys)
    assert number(text, "slide by # mm") < 1.0
    assert number(text, "height: #") > 0.9


@pytest.mark.slow
def test_pendulum_law(capsys: pytest.CaptureFixture[str]) -> None:
    text = outcome("pendulum_law", capsys)
    assert number(text, "with reaction mass # N s") > 1.2 * number(text, "ankle # N s")
    _, first, second, third = text.splitlines()
    for line in (first, second):
        assert "complete" in line and number(line, "CoM # mm from rest") < 1.0
        assert number(line, "CoP left the foot by # mm") == 0.0
    assert "complete" not in third


@pytest.mark.slow
def test_push_standing(capsys: pytest.CaptureFixture[str]) -> None:
    text = outcome("push_standing", capsys)
    assert number(text, "forward, # times M omega d") == 0.8
    assert number(text, "CoM went # mm") > 10.0
    assert number(text, "is back to # mm") < 1.0
    assert number(text, "feet # mm") < 2.0
    assert number(text, "# of 1500 ticks") == 0


def test_hardware_loop(capsys: pytest.CaptureFixture[str]) -> None:
    text = outcome("hardware_loop", capsys)
    assert 5 < number(text, "stood 4 s, # frames lost") < 50
    assert number(text, "CoM within # mm") < 2.0
    assert number(text, "# ticks relaxed") <= 5


def test_ros2_node(capsys: pytest.CaptureFixture[str]) -> None:
    """ROS 2 is on no machine that tests: it says so, after all else was imported."""
    with pytest.raises(SystemExit, match="ROS 2 is not here"):
        outcome("ros2_node", capsys)
