"""``wbc cache`` says what is kept, and deletes it."""

from pathlib import Path

import pytest

import wbc
from tests.command import wbc_command
from wbc.files import CACHE_VARIABLE


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
