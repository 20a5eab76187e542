"""The README's examples run as they stand, and its files exist."""

import re
from pathlib import Path

import pytest

from wbc.problem import load_problem

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    return re.findall(rf"```{language}\n(.*?)```", TEXT, flags=re.DOTALL)[0]


def test_the_python_example(capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, object] = {}
    exec(block("python"), names)  # the text a user would paste
    assert capsys.readouterr().out.startswith("solved")
    tick = names["tick"]
    # Of half as much again, less than a fifth is left: the rest is the posture's pull.
    start = names["start"]
    assert abs(tick.errors["inertia"][0]) < 0.1 * start.inertia[2, 2] / start.robot.mass


def test_the_yaml_example(tmp_path: Path) -> None:
    path = tmp_path / "example.yaml"
    path.write_text(block("yaml"), encoding="utf-8")
    result = load_problem(path, {"stop.duration": 2.0}).run()
    assert not result.failures


def test_pictures_and_commands() -> None:
    for picture in re.findall(r"\]\((docs/[^)]+)\)", TEXT):
        assert (ROOT / picture).is_file(), picture
    for problem in re.findall(r"wbc run (\S+\.yaml)", TEXT):
        assert (ROOT / problem).is_file(), problem
    tests = {path.name for path in (ROOT / "tests").rglob("test_*.py")}
    for name in re.findall(r"`(test_\w+\.py)", TEXT):
        assert name in tests, name


def test_every_problem_says_what_it_is_for_and_is_valid() -> None:
    for path in sorted((ROOT / "problems").glob("*.yaml")):
        assert path.read_text(encoding="utf-8").startswith("# "), path.name
        assert load_problem(path).parts
