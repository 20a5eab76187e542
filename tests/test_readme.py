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


PICTURES = re.findall(r"!\[[^]]*\]\(([^)]+)\)|<img [^>]*?src=\"([^\"]+)\"", TEXT)
COMMANDS = re.findall(r"wbc run (\S+\.yaml)", TEXT)
TESTS = re.findall(r"`(test_\w+\.py)", TEXT)


def test_every_picture_is_there() -> None:
    named = {picture for pair in PICTURES for picture in pair if picture}
    assert len(named) == TEXT.count("![") + TEXT.count("<img ") > 0
    for picture in named:
        # An 8-byte signature, and then the width of a picture [pixels].
        content = (ROOT / picture).read_bytes()
        assert content.startswith(b"\x89PNG\r\n\x1a\n"), picture
        assert int.from_bytes(content[16:20], "big") >= 600, picture


def test_commands_and_tests_exist() -> None:
    assert COMMANDS and TESTS
    for problem in COMMANDS:
        assert (ROOT / problem).is_file(), problem
    tests = {path.name for path in (ROOT / "tests").rglob("test_*.py")}
    assert set(TESTS) <= tests


PROBLEMS = sorted((ROOT / "problems").glob("*.yaml"))


def test_there_are_problems() -> None:
    assert {ROOT / problem for problem in COMMANDS} <= set(PROBLEMS)


@pytest.mark.parametrize("path", PROBLEMS, ids=lambda path: path.stem)
def test_every_problem_says_what_it_is_for_and_is_valid(path: Path) -> None:
    assert path.read_text(encoding="utf-8").startswith("# ")
    assert load_problem(path).parts
