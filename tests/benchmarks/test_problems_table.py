"""benchmarks/problems_table.py finds what differs between two results of a problem."""

import sys
from pathlib import Path

import problems_table
import pytest


def result(**changes: object) -> dict:
    summary = {"status": "converged", "ticks": 85, "com": 0.5, "mass": 40.0, **changes}
    return {"problem": "p.yaml", "exit": 0, "summary": summary}


@pytest.mark.parametrize(
    ("changes", "worst", "what"),
    [
        ({}, 0.0, "-"),
        ({"com": 0.75}, 0.25, "com: 0.5 -> 0.75"),
        ({"mass": 50.0}, 0.25, "mass: 40.0 -> 50.0"),
        ({"ticks": 86}, float("inf"), "ticks: 85 -> 86"),
        ({"status": "limit"}, float("inf"), "status: converged -> limit"),
        ({"new": 1.0}, float("inf"), "new: none -> 1.0"),
    ],
)
def test_compare_of_two_results_returns_the_largest_difference(
    changes: dict, worst: float, what: str
) -> None:
    assert problems_table.compare(result(), result(**changes)) == (worst, what)


def test_compare_of_another_exit_code_fails_whatever_the_figures() -> None:
    now = {**result(), "exit": 3}
    assert problems_table.compare(result(), now) == (float("inf"), "exit code 0 -> 3")


def test_figures_of_a_summary_are_named_leaves_without_times() -> None:
    summary = {"tasks": {"com": {"error": [1.0, 2.0]}}, "times": {"total": 3.0}, "solve_us": 4.0}
    found = dict(problems_table.figures(summary))
    assert found == {"tasks.com.error.0": 1.0, "tasks.com.error.1": 2.0}


@pytest.mark.slow
def test_a_problem_run_again_by_the_same_code_has_the_same_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, problem = tmp_path / "table.jsonl", "problems/rmp_static_lean.yaml"
    command = ["problems_table", str(path), "--problems", problem]
    monkeypatch.setattr(sys, "argv", command)
    problems_table.main()
    (line,) = problems_table.read(path)
    assert line["exit"] == 0
    assert line["summary"]["status"]
    monkeypatch.setattr(sys, "argv", [*command, "--compare"])
    with pytest.raises(SystemExit) as ended:
        problems_table.main()
    assert ended.value.code == 0
