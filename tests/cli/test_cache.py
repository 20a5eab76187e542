"""``wbc cache`` says what is kept, and deletes it."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

import wbc
from wbc.cli import app
from wbc.files import CACHE_VARIABLE


@pytest.mark.slow
def test_what_is_kept_is_told_and_deleted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    robot = wbc.Robot.load("hoap2_like")
    wbc.SelfCollision(robot)
    kept = [file for file in tmp_path.rglob("*") if file.is_file()]
    assert kept
    (tmp_path / "mine.txt").write_text("not of the package")
    told = CliRunner().invoke(app, ["cache"])
    assert told.exit_code == 0 and "MB kept" in told.output and str(tmp_path) in told.output
    assert all(file.exists() for file in kept)
    assert "MB deleted" in CliRunner().invoke(app, ["cache", "--clear"]).output
    assert not any(file.exists() for file in kept) and (tmp_path / "mine.txt").exists()
    wbc.SelfCollision(robot)  # made again
    monkeypatch.setenv(CACHE_VARIABLE, "off")
    assert "nothing is kept" in CliRunner().invoke(app, ["cache", "--clear"]).output
