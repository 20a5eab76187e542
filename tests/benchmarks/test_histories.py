"""Golden files and histories of ticks: nothing is found where nothing changed, a change is."""

import json
from pathlib import Path
from typing import Any

import golden
import numpy as np
import pytest
from qpbench.compare import SpeedVerdict

from benchmarks.tick_history import FORMAT, NothingToCompareError, changes_since, last_like
from wbc.errors import InvalidInputError

SOME = ("plain", "three priorities", "own parts", "forces", "outside limits")


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(golden, "ROBOTS", ("hoap2_like",))
    chosen = {name: golden.CATEGORIES[name] for name in SOME}
    monkeypatch.setattr(golden, "CATEGORIES", chosen)
    path = tmp_path / "golden.npz"
    golden.record(path, ticks=36, seed=1)
    return path


@pytest.mark.slow
def test_golden_compare_of_the_code_that_recorded_finds_all_the_same_to_the_bit(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert golden.compare(file, [], [], None) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[2:]]
    assert len(rows) == 9  # two levels, forces at one of them
    for row in rows:
        ticks, *differences, _off_before, _off_now, bitwise, status, beyond = row[-12:-2]
        assert ticks == bitwise == "4"
        assert [*map(float, differences)] == [0.0] * 4
        assert status == beyond == "0"


@pytest.mark.slow
def test_golden_compare_with_a_recorded_number_or_status_changed_fails_and_says_where(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with np.load(file) as before:
        arrays = {name: before[name] for name in before.files}
    for name in ("velocity", "exact_velocity"):
        arrays[name][3] += 1e-6  # of episode 0, tick 0
    with file.open("wb") as out:
        np.savez(out, **arrays)
    assert golden.compare(file, ["plain"], [], None) == 1
    assert "0 0 (hoap2_like) FAILED" in capsys.readouterr().out
    arrays["velocity"][3] -= 1e-6
    arrays["status"][1] = "failed"
    with file.open("wb") as out:
        np.savez(out, **arrays)
    assert golden.compare(file, ["plain"], [], None) == 1
    assert "episode 0 1 (hoap2_like): failed" in capsys.readouterr().out


def figures(seed: int, slower: float = 1.0, rounds: int = 5, **others: Any) -> dict[str, Any]:
    """Return what benchmarks/tick.py would write, with noise of 3 %."""
    noise = np.exp(0.03 * np.random.default_rng(seed).standard_normal(rounds))
    ticks = {"daqp equality": {"passes": (0.05 * slower * noise).tolist()}}
    same = {"format": FORMAT, "robot": "g1", "machine": "this"}
    return {**same, "rounds": rounds, "ticks": ticks, **others}


def written(path: Path, *runs: dict[str, Any]) -> Path:
    path.write_text("".join(f"{json.dumps(one)}\n" for one in runs))
    return path


def test_the_last_run_alike_is_taken(tmp_path: Path) -> None:
    runs = figures(0), figures(1), figures(2, robot="talos"), figures(3, machine="that")
    path = written(tmp_path / "h.jsonl", *runs)
    assert last_like(path, figures(9)) == runs[1]
    assert last_like(path, figures(9, robot="talos")) == runs[2]
    with pytest.raises(NothingToCompareError, match="no earlier run with robot icub"):
        last_like(path, figures(9, robot="icub"))
    with pytest.raises(NothingToCompareError, match="no earlier run"):
        last_like(tmp_path / "none.jsonl", figures(9))


def test_a_change_is_seen_and_too_few_rounds_and_other_ticks_are_said() -> None:
    (found,) = changes_since(figures(0), figures(1, 1.3)).values()
    assert found.verdict is SpeedVerdict.SLOWER
    with pytest.raises(NothingToCompareError, match="needs 3 rounds each, has 2"):
        changes_since(figures(0, rounds=2), figures(1))
    with pytest.raises(NothingToCompareError, match="other ticks: daqp equality"):
        changes_since(figures(0), figures(1, ticks={"new": {"passes": [1e-5] * 5}}))


@pytest.mark.parametrize("line", ["", "[1]", "{}", '{"format": "other"}', "{"])
def test_what_is_no_history_is_refused(line: str, tmp_path: Path) -> None:
    path = tmp_path / "h.jsonl"
    path.write_text(f"{json.dumps(figures(0, machine='that'))}\n{line}\n")
    with pytest.raises(InvalidInputError, match=r"h\.jsonl:2: is no line"):
        last_like(path, figures(1))
