"""Tables that break no words, and how an inertia out of reach reads."""

import io
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from wbc.cli.errors import complain
from wbc.cli.printing import heads, print_result, unwatched_text
from wbc.problem import load_problem
from wbc.run.result import Worst

PROBLEMS = Path(__file__).parents[2] / "problems"
WORDS = ("left_shoulder_roll_joint", "upper", "bound", "right_ankle_pitch_joint +0.123")
HEADS = ("direction [deg]", "M omega d [N s]", "survived", "[N s]", "mass", "fails by")
NUMBERS = ("0.1114", "0.3300", "0.1480", "kg m^2")


@pytest.mark.parametrize("width", [100, 80, 74])
def test_words_are_whole_where_they_can_be(width: int) -> None:
    table = heads("inertia [kg m^2]", "start", "wanted", "reached", "largest entry")
    table.add_row(" ".join(WORDS[:3]), *NUMBERS[:3], WORDS[3])
    table.add_row("a text of many short words that is folded", *NUMBERS[1:])
    text = io.StringIO()
    Console(file=text, width=width).print(table)
    told = text.getvalue()
    assert max(map(len, told.splitlines())) <= width
    for word in " ".join((*WORDS, *NUMBERS, "inertia", "reached", "largest")).split():
        assert word in told.replace("\n", " ").split()


def test_pairs_that_are_not_watched_are_told_by_reason_and_not_without_an_end() -> None:
    """A TALOS with hands had 31 of them, on as many lines."""
    pairs = {f"finger {k} vs palm": "in contact when standing" for k in range(4)}
    near = "8.8 mm apart when standing, too near to tell"
    told = unwatched_text({**pairs, "thumb vs palm": near})
    together = ", ".join(pairs)
    assert told == f"in contact when standing: {together}; {near}: thumb vs palm"
    many = unwatched_text({f"finger {k} vs palm": near for k in range(31)})
    assert many.endswith("and 25 more (wbc collisions lists all)")


def test_long_words_beside_many_columns_are_told_to_their_ends() -> None:
    table = heads(*HEADS)
    reason = "right_wrist_yaw_link touched the ground"
    table.add_row("112.5", "20.84", "1.5", "31.27", "2.11", reason)
    for width in (80, 60, 44):
        text = io.StringIO()
        Console(file=text, width=width).print(table)
        told = text.getvalue()
        assert max(map(len, told.splitlines())) <= width
        letters = [told.count(letter) - "".join(map(str, HEADS)).count(letter) for letter in "_qh"]
        assert letters == [reason.count(letter) for letter in "_qh"]


def test_what_no_width_can_hold_is_folded() -> None:
    table = heads("a", "b")
    table.add_row("x" * 30, "y" * 30)
    text = io.StringIO()
    Console(file=text, width=40).print(table)
    assert max(map(len, text.getvalue().splitlines())) <= 40
    assert text.getvalue().count("x") == 30


def test_an_inertia_out_of_reach_says_how_far_and_what_held_it() -> None:
    result = load_problem(PROBLEMS / "astronaut_expand.yaml").run()
    reading = result.inertia["shape"]
    assert [f"{reading.share(k):.2f}" for k in range(3)] == ["0.45", "0.28", "0.20"]
    assert result.reach.startswith(
        "as far as its joints allow: shape 20 to 45 % of what is wanted, at "
    )
    assert result.held_at_end[0] in result.reach
    held = [name for name, on in result.history.active.items() if on[-1]]
    assert sorted(held) == sorted(result.held_at_end)
    assert result.summary()["reach"] == result.reach


def test_an_inertia_that_other_tasks_hold_back_is_not_laid_to_the_joints() -> None:
    """Without an active limit nothing was said: "every tolerance met", and short of its target."""
    heavy = {"tasks.posture.weight": 10.0, "tasks.posture.gain": 0.5, "stop.accept": {}}
    result = load_problem(PROBLEMS / "shape_standing_g1.yaml", heavy).run()
    assert result.status.value == "converged" and not result.inertia["shape"].arrived
    assert not result.held_at_end
    assert result.reach.startswith("as far as its other tasks allow: shape ")


def test_one_that_arrives_or_is_still_on_its_way_says_nothing() -> None:
    near = {"tasks.shape.target": [0.112, 0.098, 0.023], "stop.duration": 3.0}
    result = load_problem(PROBLEMS / "astronaut_expand.yaml", near).run()
    assert result.status.value == "converged" and result.inertia["shape"].arrived
    assert result.reach == ""
    short = load_problem(PROBLEMS / "astronaut_expand.yaml", {"stop.duration": 0.1}).run()
    assert not short.inertia["shape"].arrived and short.reach == ""


@pytest.mark.parametrize(
    ("left", "said"),
    [(-2e-11, "at least 0 left"), (2e-3, "at least 0.002 left"), (-1e-8, "exceeded by at most")],
)
def test_rounding_at_a_joints_limit_is_not_told_as_beyond_it(left, said, capsys) -> None:
    one = load_problem(
        PROBLEMS / "fig7_forward_hoap2.yaml", {"stop.duration": 0.05, "tasks.com.ramp": 0.05}
    )
    result = replace(one.run(), margin=Worst(left, "left_knee", 3))
    print_result(result, [])
    assert said in capsys.readouterr().out


@pytest.mark.parametrize(("value", "coloured"), [("1", False), ("", True)])
def test_no_color_is_heeded_by_errors(monkeypatch, value, coloured) -> None:
    """Tables heeded it, "error:" was red all the same."""
    monkeypatch.setenv("NO_COLOR", value)
    terminal = io.StringIO()
    terminal.isatty = lambda: True  # type: ignore[method-assign]
    monkeypatch.setattr("sys.stderr", terminal)
    complain("a mistake")
    assert ("\x1b[" in terminal.getvalue()) is coloured
    assert "a mistake" in terminal.getvalue()
