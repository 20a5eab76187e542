"""What the README's examples come to; that all of its blocks run is tested in docs/."""

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


def test_it_is_short() -> None:
    assert 150 <= TEXT.count("\n") <= 200


COMMANDS = re.findall(r"wbc (?:run|check) (\S+\.yaml)", TEXT)


PROBLEMS = sorted((ROOT / "problems").glob("*.yaml"))


def test_there_are_problems_and_each_says_what_it_is_for() -> None:
    assert COMMANDS
    assert {ROOT / problem for problem in COMMANDS} <= set(PROBLEMS)
    assert all(path.read_text(encoding="utf-8").startswith("# ") for path in PROBLEMS)


def test_every_link_leads_somewhere() -> None:
    links = [link for link in re.findall(r"\]\(([^)]+)\)", TEXT) if "://" not in link]
    assert len(links) > 20
    for link in links:
        assert (ROOT / link).is_file(), link
