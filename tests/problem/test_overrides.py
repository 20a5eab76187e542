"""Key paths as text, and values that replace those of a file."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wbc.errors import ProblemFileError
from wbc.problem.overrides import apply_overrides, parse_override
from wbc.problem.source import parse_path, written
from wbc.problem.yaml_reader import parse

FILE = "robot: g1\ntasks:\n  com: {type: com, target: [1, 2, 3]}\nlimits: none\n"


def overridden(overrides: dict[str, Any]) -> Any:
    return apply_overrides(parse(FILE, "p.yaml"), overrides)


def refusal(overrides: dict[str, Any]) -> str:
    with pytest.raises(ProblemFileError) as caught:
        overridden(overrides)
    return str(caught.value)


@pytest.mark.parametrize(
    "path",
    [
        ("a",),
        ("tasks", "com", "target", 0),
        ("locked", "waist.yaw", "x"),
        ("j", "*_knee*"),
        ("a", 1, 2),
    ],
)
def test_paths_survive_being_written(path: tuple[str | int, ...]) -> None:
    assert parse_path(written(path)) == path


def test_paths_as_users_write_them() -> None:
    assert parse_path("tasks.com.target[2]") == ("tasks", "com", "target", 2)
    assert parse_path("robot.locked.'waist.yaw'") == ("robot", "locked", "waist.yaw")
    assert parse_path("tasks.left foot.gain") == ("tasks", "left foot", "gain")


@pytest.mark.parametrize(
    "text", ["", ".", "a.", ".a", "a..b", "a[", "a[x]", 'a."b', "a[0]b", "a]", f"a[{'9' * 10_000}]"]
)
def test_what_is_no_path(text: str) -> None:
    with pytest.raises(ProblemFileError, match="is not a key path"):
        parse_path(text)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("a.b=0.3", 0.3),
        ("a.b=1e-6", 1e-6),
        ("a.b=[x, y]", ["x", "y"]),
        ("a.b={offset: [0, 0, 1]}", {"offset": [0, 0, 1]}),
        ("a.b=null", None),
        ("a.b = none", "none"),
        ("a.b=x=y", "x=y"),
    ],
)
def test_values_are_read_as_yaml(text: str, value: Any) -> None:
    assert parse_override(text) == ("a.b", value)


@pytest.mark.parametrize("text", ["a.b", "=3", "a.b=", " =", "a.b: 3"])
def test_assignments_that_are_none(text: str) -> None:
    with pytest.raises(ProblemFileError, match=r"expected PATH=VALUE"):
        parse_override(text)


@pytest.mark.parametrize(
    "value",
    ["9" * 10_000, "0x" + "f" * 10_000, "[1, 2", "!!python/object:x {}", "{a: 1, a: 2}", "&x [*x]"],
)
def test_values_pass_the_same_checks_as_a_file(value: str) -> None:
    with pytest.raises(ProblemFileError, match=r"^--set a\.b"):
        parse_override(f"a.b={value}")


def test_values_are_replaced_and_added() -> None:
    source = overridden(
        {"robot": "talos", "tasks.com.target[1]": 9, "stop.duration": 3, "tasks.com.gain": 0.1}
    )
    assert source.data == {
        "robot": "talos",
        "tasks": {"com": {"type": "com", "target": [1, 9, 3], "gain": 0.1}},
        "limits": "none",
        "stop": {"duration": 3},
    }
    assert source.where(("tasks", "com", "target", 1)) == "--set tasks.com.target[1]"
    assert source.where(("tasks", "com", "target", 0)) == "p.yaml:3"


def test_what_stands_below_a_replaced_value_was_replaced_too() -> None:
    source = overridden({"tasks.com": {"type": "com", "target": "start"}})
    assert source.where(("tasks", "com", "target")) == "--set tasks.com"


def test_a_value_that_a_later_one_replaces_is_refused() -> None:
    """It was lost without a word; the other way round both count."""
    whole = {"tasks.com": {"type": "com", "target": "start"}}
    with pytest.raises(ProblemFileError, match=r"--set tasks\.com: replaces tasks\.com\.gain with"):
        overridden({"tasks.com.gain": 0.1, **whole})
    assert overridden({**whole, "tasks.com.gain": 0.1}).data["tasks"]["com"]["gain"] == 0.1
    assert overridden({'tasks."com".gain': 0.2, "tasks.com.gain": 0.1}).data  # the last one counts


def test_arrays_and_tuples_become_lists() -> None:
    source = overridden({"tasks.com.target": np.arange(3.0), "tasks.com.gain": np.float64(0.5)})
    assert source.data["tasks"]["com"] == {"type": "com", "target": [0.0, 1.0, 2.0], "gain": 0.5}
    assert overridden({"robot": Path("a/b.urdf")}).data["robot"] == "a/b.urdf"
    assert overridden({"tasks.com.axes": ("x",)}).data["tasks"]["com"]["axes"] == ["x"]


def test_the_file_itself_is_not_changed() -> None:
    source = parse(FILE, "p.yaml")
    apply_overrides(source, {"tasks.com.target[0]": 7})
    assert source.data["tasks"]["com"]["target"] == [1, 2, 3]


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("tasks.cmo.gain", "no task 'cmo'; did you mean 'com'?"),
        ("tasks.com.target[3]", "'tasks.com.target' has 3 entries, the last is [2]"),
        ("robot[0]", "'robot' is not a list"),
        ("robot.locked.x", "'robot' is 'g1' and has no keys; replace it as a whole"),
        ("limits.margin", "'limits' is 'none' and has no keys"),
        ("tasks.com.target.x", "'tasks.com.target' is a list and has no keys"),
        ("tasks..com", "is not a key path"),
    ],
)
def test_paths_that_lead_nowhere(path: str, words: str) -> None:
    message = refusal({path: 1})
    assert message.startswith("--set ")
    assert words in message


def test_a_section_that_an_override_made_is_not_looked_for_in_the_file() -> None:
    """The line of another key was named."""
    source = overridden({"simulation.foo.bar": 3, "tasks.com.gain": 0.1})
    for made in ("simulation", "simulation.foo", "simulation.foo.bar"):
        assert source.where(parse_path(made)) == "--set simulation.foo.bar"
    assert source.where(parse_path("tasks")).startswith("p.yaml:")
