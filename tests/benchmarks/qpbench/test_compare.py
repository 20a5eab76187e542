"""Verdicts on a change: not fooled by drift and noise; the test set for qpbenchmark, its pages."""

import ast
import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import qpsolvers
from pyarrow import parquet
from qpbench.compare import SpeedVerdict, compare
from qpbench.export import NAME, export_qpbenchmark
from qpbench.page import has_section, put_section, with_section

from tests.benchmarks.qpbench.test_measure import solvable
from wbc.qp.active_set import ActiveSet


def figures(
    seed: int, slower: float = 1.0, passes: int = 5, success: float = 1.0
) -> dict[str, Any]:
    """Return what wbc bench would write on a noisy machine of a speed of its own."""
    rng = np.random.default_rng(seed)
    speed = np.exp(0.3 * rng.standard_normal())
    drift = np.exp(0.1 * rng.standard_normal(passes).cumsum())
    sequences = {}
    for name, time in (("smooth", 1e-4), ("hard", 4e-4)):
        noise = np.exp(0.02 * rng.standard_normal((2, passes)))
        sequences[name] = {
            "success": success, "QPs": 100, "median": time,
            "passes": (time * slower * speed * drift * noise[0]).tolist(),
            "reference": (1e-3 * speed * drift * noise[1]).tolist(),
        }  # fmt: skip
    return {
        "machine": "this",
        "sequences": {name: {"digest": name} for name in sequences},
        "accuracies": {"1e-06": {"solvers": {"daqp": {"sequences": sequences}}}},
    }


def verdicts(slower: float, seeds: int) -> list[SpeedVerdict]:
    found = []
    for seed in range(seeds):
        (change,), notes = compare(figures(2 * seed), figures(2 * seed + 1, slower))
        assert not notes
        found.append(change.verdict)
    return found


def test_the_same_solver_is_never_called_slower_or_faster() -> None:
    assert verdicts(1.0, 300) == [SpeedVerdict.SAME] * 300


def test_a_change_that_nobody_should_act_upon_is_none() -> None:
    assert set(verdicts(1.03, 100)) == {SpeedVerdict.SAME}


@pytest.mark.parametrize(
    ("slower", "told"), [(1.3, SpeedVerdict.SLOWER), (0.77, SpeedVerdict.FASTER)]
)
def test_a_real_change_is_found(slower: float, told: SpeedVerdict) -> None:
    found = verdicts(slower, 100)
    assert set(found) <= {told, SpeedVerdict.SAME} and found.count(told) >= 99


def test_the_interval_holds_the_true_ratio() -> None:
    """It is two-sided at 99.8 %: at most a few of 500 miss it."""
    missed = 0
    for seed in range(500):
        (change,), _ = compare(figures(2 * seed), figures(2 * seed + 1, 1.2))
        missed += not change.low <= 1.2 <= change.high
    assert missed <= 5


def test_lost_answers_count_more_than_time() -> None:
    (worse,), _ = compare(figures(0), figures(1, 0.5, success=0.97))
    assert worse.verdict is SpeedVerdict.FAILS_MORE and worse.success == (1.0, 0.97)
    (better,), _ = compare(figures(0, success=0.97), figures(1))
    assert better.verdict is SpeedVerdict.FAILS_LESS


def test_too_few_passes_give_no_verdict() -> None:
    (change,), _ = compare(figures(0, passes=2), figures(1, 3.0))
    assert (
        change.verdict is SpeedVerdict.UNKNOWN
        and "needs 3 passes each, has 2 and 5" in change.reason
    )


def test_only_the_same_qps_are_compared_and_the_rest_is_said() -> None:
    old, new = figures(0), figures(1)
    new["sequences"]["hard"]["digest"] = "others"
    new["machine"] = "that"
    new["accuracies"]["1e-06"]["solvers"]["new"] = copy.deepcopy(
        new["accuracies"]["1e-06"]["solvers"]["daqp"]
    )
    (change,), notes = compare(old, new)
    assert change.solver == "daqp"
    told = " ".join(notes)
    assert "another machine" in told and "'hard' has other QPs" in told and "'new'" in told
    del new["sequences"]["smooth"]
    changes, notes = compare(old, new)
    assert not changes and "'smooth' is gone" in " ".join(notes)


# qpbenchmark.problem_list.ProblemList.KEYS, 2.7
KEYS = ["P", "q", "G", "h", "A", "b", "lb", "ub", "name"]
PAGE = "# Results\n\n<!-- ticks -->\n\nold\n\n<!-- /ticks -->\n\n## Campaigns\n\nby hand\n"


def test_problems_have_the_same_optimum_in_its_form(tmp_path: Path) -> None:
    sequence = solvable()
    table, *scripts = export_qpbenchmark(tmp_path / "set", [sequence])
    rows = parquet.read_table(table).to_pylist()
    assert list(rows[0]) == KEYS
    assert [row["name"] for row in rows] == [f"drifting {k}" for k in range(8)]
    assert rows[-1]["G"] is None  # no inequality rows
    for row, qp in zip(rows, sequence.qps, strict=True):
        # As qpbenchmark.parquet_test_set does.
        data = {key: None if row[key] is None else np.array(row[key]) for key in KEYS[:-1]}
        for key in ("P", "G", "A"):
            data[key] = None if data[key] is None else data[key].reshape(-1, data["q"].size)
        found = qpsolvers.solve_problem(qpsolvers.Problem(**data), "piqp")
        assert np.allclose(found.x, ActiveSet().answer(qp).x, atol=1e-6)
    # qpbenchmark takes the class that is named like the file.
    tree = ast.parse(scripts[0].read_text())
    classes = [node.name for node in tree.body if isinstance(node, ast.ClassDef)]
    assert classes == [NAME.title().replace("_", "")]
    compile(scripts[1].read_text(), "warm", "exec")


def test_names_of_sequences_do_not_end_the_string_that_they_are_in(tmp_path: Path) -> None:
    odd = '\\"; import os; """\n{x}'
    sequence = replace(solvable(), name=odd)
    _, script, _ = export_qpbenchmark(tmp_path, [sequence])
    tree = ast.parse(script.read_text(encoding="utf-8"))
    (told,) = (
        node.body[-1].value.value
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and node.name == "description"
    )
    assert told == f"8 QPs of 1 sequences: {odd}."


def test_a_section_is_replaced_in_place_twice_the_same() -> None:
    once = with_section(PAGE, "ticks", "new\n")
    assert once == PAGE.replace("old", "new")
    assert with_section(once, "ticks", "new") == once


def test_a_section_that_is_not_there_comes_last() -> None:
    assert not has_section(PAGE, "solvers")
    page = with_section(PAGE, "solvers", "table")
    assert page == f"{PAGE}\n<!-- solvers -->\n\ntable\n\n<!-- /solvers -->\n"
    assert has_section(page, "solvers") and with_section(page, "ticks", "old") == page
    # An end without a beginning before it is no place.
    assert not has_section("<!-- /a --> <!-- a -->", "a")


def test_a_page_that_is_not_there_is_begun(tmp_path: Path) -> None:
    path = tmp_path / "new.md"
    put_section(path, "ticks", "one")
    put_section(path, "ticks", "two")
    assert path.read_text() == "<!-- ticks -->\n\ntwo\n\n<!-- /ticks -->\n"
