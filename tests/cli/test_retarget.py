"""``wbc retarget``: its defaults, and what it says of mistakes before any work is done."""

import inspect
from pathlib import Path

import numpy as np
import pytest

import wbc.cli.retarget as command
from tests.command import wbc_command
from tests.human.walker import recorded, write_trc
from tests.retargeting.humans import crouching
from wbc.cli import human_options
from wbc.cli.analyze_human import HumanOptions
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
    assert human["sex"].default == human_options.SEX


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
    result = wbc_command("retarget", walk, "--robot", "hoap2_like", *options)
    assert result.exit_code in (1, 2)
    assert said in result.output
    assert not (walk.parent / "x.npz").exists()


def test_a_file_says_what_options_do(walk: Path) -> None:
    path = walk.parent / "walk.yaml"
    path.write_text("motion: walk.trc\nrobot: hoap2_like\nrate: 40.0\nlinks: {trnk: torso}\n")
    result = wbc_command("retarget", path)
    assert result.exit_code == 1 and "did you mean 'trunk'" in result.output
    # What the command line says goes before what the file says.
    options = ["--robot", "hoap2_lik", "--rate", "50"]
    assert "hoap2_lik" in wbc_command("retarget", path, *options).output
    path.write_text("motion: walk.trc\nrobto: g1\n")
    result = wbc_command("retarget", path)
    assert result.exit_code == 1 and "robto" in result.output and "robot" in result.output
    path.write_text("motion: walk.trc\nrobot: hoap2_like\nroll: 2.0\n")
    result = wbc_command("retarget", path)
    assert result.exit_code == 1 and "walk.yaml:3" in result.output


@pytest.mark.slow
def test_files_of_all_layouts_and_what_came_of_it(walk: Path, monkeypatch) -> None:
    monkeypatch.chdir(walk.parent)
    files = ["m.npz", "m.csv", "m.mcap"]
    options = [word for file in files for word in ("-o", file)]
    found = wbc_command("retarget", walk, "--robot", "hoap2_like", *options)
    assert found.exit_code == 0, found.output
    for said in ("scale", "left foot", "angular momentum: correlation", "slide by"):
        assert said in found.output
    assert all(f"written  {file}" in found.output and Path(file).stat().st_size for file in files)
    with np.load("m.npz") as arrays:
        assert np.isfinite(arrays["q"]).all() and len(arrays["q"]) == len(arrays["time"])


@pytest.mark.slow
def test_a_standing_motion_is_a_problem_that_is_simulated(tmp_path: Path, monkeypatch) -> None:
    pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(HumanOptions, "motion", lambda *given, **how: crouching(1.2))
    options = ["--robot", "hoap2_like", "--rate", "40", "-o", "m.npz", "--problem", "m.yaml", "-q"]
    found = wbc_command("retarget", "any.trc", *options)
    assert found.exit_code == 0, found.output
    Path("m.yaml").write_text(
        Path("m.yaml")
        .read_text()
        .replace("&motion {motion: m.npz", "&motion {motion: m.npz, slower: 1.5")
    )
    shown = wbc_command("sim", "m.yaml", "-o", "run.json")
    assert shown.exit_code == 0, shown.output
    assert "rms of its peak" in shown.output and "joints" in shown.output
