"""The test set for qpbenchmark, and sections of a page that are replaced in place."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import qpsolvers
from pyarrow import parquet
from qpbench.export import NAME, export_qpbenchmark
from qpbench.page import has_section, put_section, with_section

from tests.benchmarks.qpbench.test_measure import solvable
from wbc.errors import MissingPackageError
from wbc.qp.active_set import ActiveSet

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


def test_pyarrow_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wbc.extras.find_spec", lambda name: None)
    with pytest.raises(MissingPackageError, match=r"pip install 'wbc\[batch\]'"):
        export_qpbenchmark(tmp_path, [solvable()])


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
