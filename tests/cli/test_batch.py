"""``wbc batch``: from a file to a table, ended and gone on with, and refused."""

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import IO

import pytest
from typer.testing import Result

from tests.batch.conftest import CAMPAIGN
from tests.command import signalling, wbc_command
from tests.texts import CHEAP
from wbc.batch import BatchProgress, read_rows
from wbc.cli.progress import batch_state
from wbc.files import write_whole
from wbc.journal import Journal


def run(folder: Path, *options: object, text: str = CAMPAIGN) -> Result:
    (folder / "stand.yaml").write_text(CHEAP)
    path = folder / "campaign.yaml"
    path.write_text(text)
    return wbc_command("batch", path, *options)


@pytest.mark.slow
def test_ended_by_ctrl_c_it_goes_on_to_one_table(tmp_path, monkeypatch) -> None:
    signalling(monkeypatch, Journal, "add", 5)  # the first writes what the campaign is
    ended = run(tmp_path, "--workers", 1)
    assert ended.exit_code == 130, ended.output
    assert "the same command goes on" in ended.output and "4 of 12 runs" in ended.output
    table, kept = tmp_path / "campaign.parquet", tmp_path / "campaign.parquet.partial"
    assert not table.exists() and len(kept.read_text().splitlines()) == 5

    other = run(tmp_path, "--workers", 1, text=CAMPAIGN.replace("seeds: 2", "seeds: 3"))
    assert other.exit_code == 1 and "campaign differs" in " ".join(other.output.split())
    whole = run(tmp_path, "--workers", 1)
    assert whole.exit_code == 0, whole.output
    assert "goes on with 4 of 12 runs" in whole.output and "stand: 12 completed" in whole.output
    assert not kept.exists()
    rows, made_of = read_rows(table)
    assert [row["run"] for row in rows] == list(range(12))
    assert made_of["campaign"]["seeds"] == 2 and "numpy" in made_of["versions"]

    again = run(tmp_path)
    assert again.exit_code == 0 and "has all 12 runs already" in again.output
    changed = run(tmp_path, text=CAMPAIGN.replace("seeds: 2", "seeds: 3"))
    assert changed.exit_code == 1 and "another campaign (campaign" in " ".join(
        changed.output.split()
    )


@pytest.mark.slow
def test_a_table_that_cannot_be_saved_is_saved_elsewhere_and_the_runs_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def full_disk(path: Path, fill: Callable[[IO[bytes]], object]) -> None:
        if path.parent == tmp_path:
            raise OSError(28, "No space left on device")
        write_whole(path, fill)

    monkeypatch.setattr("wbc.batch.row.write_whole", full_disk)
    answer = run(tmp_path, "--workers", 1, text="problems: [stand.yaml]\n")
    assert answer.exit_code == 1
    assert "cannot be written: No space left on device" in answer.stderr
    (saved,) = tmp_path.glob("wbc-*/campaign.parquet")
    assert len(read_rows(saved)[0]) == 1
    assert (tmp_path / "campaign.parquet.partial").exists()


def test_checked_only(tmp_path: Path) -> None:
    result = run(tmp_path, "--check")
    assert result.exit_code == 0
    assert "12 runs (1 problem x 3 of tasks.com.gain x 2 of controller.solver x 2 seeds)" in (
        " ".join(result.output.split())
    )
    assert not list(tmp_path.glob("*.p*rtial*"))


@pytest.mark.slow
def test_what_only_together_is_wrong_is_named_in_table_and_exit_code(tmp_path: Path) -> None:
    """Every value is fine with the first of the others, the last two together are not."""
    text = (
        "problems: [stand.yaml]\n"
        "grid: {stop.duration: [0.05, 0.02], tasks.com.ramp: [0.01, 0.04]}\n"
    )
    result = run(tmp_path, "--workers", 1, text=text)
    assert result.exit_code == 3, result.output
    assert "3 completed, 1 error" in result.output
    assert "run 3 (stand, stop.duration=0.02, tasks.com.ramp=0.04): error" in result.output
    rows, _ = read_rows(tmp_path / "campaign.parquet")
    assert [row["status"] for row in rows] == ["completed"] * 3 + ["error"]
    assert "longer than the run" in rows[3]["reason"]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("-o", "table.csv"), ".parquet"),
        (("-o", "nowhere/table.parquet"), "there is no folder"),
        (("--workers", 0), "workers"),
    ],
)
def test_bad_input(tmp_path: Path, options: tuple[object, ...], told: str) -> None:
    result = run(tmp_path, *options)
    assert result.exit_code in (1, 2) and told in result.output


@pytest.mark.parametrize(
    ("package", "extra", "options"),
    [("pyarrow", "batch", ()), ("distributed", "cluster", ("--cluster", "tcp://here:1"))],
)
def test_what_is_not_installed_is_said(tmp_path, monkeypatch, package, extra, options) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        "wbc.extras.find_spec", lambda name: None if name == package else find(name)
    )
    result = run(tmp_path, *options)
    assert result.exit_code == 1 and f"pip install 'wbc[{extra}]'" in result.output


@pytest.mark.parametrize(
    ("done", "new", "seconds", "told"),
    [
        (100, 50, 10.0, "5 per s, 3 min left"),
        (100, 10, 100.0, "10 s each, 2.5 h left"),
        (999, 1, 0.5, "2 per s, 0 s left"),
    ],
)
def test_rate_and_remaining_time(done: int, new: int, seconds: float, told: str) -> None:
    assert batch_state(BatchProgress(done, 1000, new, {}), seconds) == told
