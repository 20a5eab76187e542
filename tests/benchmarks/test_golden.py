"""benchmarks/golden.py records ticks, finds nothing where nothing changed, and finds a change."""

from pathlib import Path

import golden
import numpy as np
import pytest

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
