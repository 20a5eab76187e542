"""A history of ticks: the last run alike counts, what is none is refused."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from qpbench.compare import SpeedVerdict

from benchmarks.tick_history import FORMAT, NothingToCompareError, changes_since, last_like
from wbc.errors import InvalidInputError


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
