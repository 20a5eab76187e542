"""``wbc retarget``: its defaults, and what it says of mistakes before any work is done."""

import inspect
from pathlib import Path

import pytest
from typer.testing import CliRunner

import wbc.cli.retarget as command
from tests.human.walker import recorded, write_trc
from wbc.cli import app
from wbc.human import human_motion
from wbc.human.body import HumanBody
from wbc.retargeting import retarget


def test_defaults_are_those_of_the_library() -> None:
    library, human = (inspect.signature(one).parameters for one in (retarget, human_motion))
    assert library["rate"].default == command.RATE
    assert library["duration"].default == command.DURATION
    assert library["friction"].default == command.FRICTION
    assert library["margin"].default == command.MARGIN
    assert library["roll"].default == command.ROLL
    assert human["sex"].default == command.SEX


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    recording, _ = recorded(HumanBody.of(1.76, 72.0, "male"), seconds=0.2)
    path = tmp_path / "walk.trc"
    write_trc(path, recording)
    return path


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["-o", "x.foo"], "written as .npz"),
        (["-o", "x.npz", "--link", "trnk=torso"], "did you mean 'trunk'"),
        (["-o", "x.npz", "--layout", "trakcing"], "trakcing"),
        (["-o", "x.mcap", "--robot", "hoap2_lik"], "hoap2_like"),
        (["-o", "x.csv", "--problem", "x.yaml"], "needs the motion's file"),
        (["-o", "x.npz", "--problem", "x.txt"], "is written as .yaml"),
    ],
)
def test_mistakes_are_named(walk: Path, options: list[str], said: str, monkeypatch) -> None:
    monkeypatch.chdir(walk.parent)
    result = CliRunner().invoke(app, ["retarget", str(walk), "--robot", "hoap2_like", *options])
    assert result.exit_code in (1, 2)
    assert said in result.output
    assert not (walk.parent / "x.npz").exists()


def test_a_file_says_what_options_do(walk: Path) -> None:
    path = walk.parent / "walk.yaml"
    path.write_text("motion: walk.trc\nrobot: hoap2_like\nrate: 40.0\nlinks: {trnk: torso}\n")
    result = CliRunner().invoke(app, ["retarget", str(path)])
    assert result.exit_code == 1 and "did you mean 'trunk'" in result.output
    # What the command line says goes before what the file says.
    options = ["--robot", "hoap2_lik", "--rate", "50"]
    assert "hoap2_lik" in CliRunner().invoke(app, ["retarget", str(path), *options]).output
    path.write_text("motion: walk.trc\nrobto: g1\n")
    result = CliRunner().invoke(app, ["retarget", str(path)])
    assert result.exit_code == 1 and "robto" in result.output and "robot" in result.output
    path.write_text("motion: walk.trc\nrobot: hoap2_like\nroll: 2.0\n")
    result = CliRunner().invoke(app, ["retarget", str(path)])
    assert result.exit_code == 1 and "walk.yaml:3" in result.output
