"""``wbc doctor`` says what runs here, ``wbc cache`` what is kept, and deletes it."""

import re
from pathlib import Path

import pytest

import wbc
from tests.command import wbc_command
from wbc.files import CACHE_VARIABLE
from wbc.robot import kernel


def test_versions_the_core_and_its_distance_from_pinocchio_are_said() -> None:
    answer = wbc_command("doctor")
    assert answer.exit_code == 0, answer.output
    assert "cffi " in answer.output and "pin 4" in answer.output
    assert re.search(r"core: \S*_core\S*\.so", answer.output)
    apart = re.search(r"against Pinocchio on hoap2_like: (\S+)", answer.output)
    assert apart is not None and 0.0 < float(apart[1]) < 1e-11  # rounding, of sums in another order


def test_a_core_that_is_wrong_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    right = kernel._body
    monkeypatch.setattr(kernel, "_body", lambda inertia: right(inertia) * (1 + 1e-3))
    answer = wbc_command("doctor")
    assert answer.exit_code == 1
    assert "'hoap2_like': the compiled core and Pinocchio" in " ".join(answer.stderr.split())


@pytest.mark.slow
def test_what_is_kept_is_told_and_deleted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    robot = wbc.Robot.load("hoap2_like")
    wbc.SelfCollision(robot)
    kept = [file for file in tmp_path.rglob("*") if file.is_file()]
    assert kept
    (tmp_path / "mine.txt").write_text("not of the package")
    told = wbc_command("cache")
    assert told.exit_code == 0 and "MB kept" in told.output and str(tmp_path) in told.output
    assert all(file.exists() for file in kept)
    assert "MB deleted" in wbc_command("cache", "--clear").output
    assert not any(file.exists() for file in kept) and (tmp_path / "mine.txt").exists()
    wbc.SelfCollision(robot)  # made again
    monkeypatch.setenv(CACHE_VARIABLE, "off")
    assert "nothing is kept" in wbc_command("cache", "--clear").output
