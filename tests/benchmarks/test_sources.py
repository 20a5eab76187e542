"""Studies run as scripts, and do not go on with what was measured with other code."""

import ast
from functools import partial
from pathlib import Path

import pytest
import walking
from sources import code_of

from wbc.errors import InvalidInputError
from wbc.journal import Journal

FOLDER = Path(__file__).parents[2] / "benchmarks"
AS_MODULES = {"mutation.py", "mutation_trials.py"}  # python -m benchmarks.mutation


def test_the_code_is_every_source_by_name_and_content(tmp_path: Path) -> None:
    code = partial(code_of.__wrapped__, tmp_path)
    (tmp_path / "gait").mkdir()
    law, rows = tmp_path / "gait" / "law.py", tmp_path / "rows.c"
    law.write_text("gain = 1.0\n")
    rows.write_text("int rows;\n")
    seen = {code()}
    (tmp_path / "law.pyc").write_text("compiled")
    assert code() in seen
    law.write_text("gain = 2.0\n")
    seen.add(code())
    rows.rename(tmp_path / "other.c")
    seen.add(code())
    assert len(seen) == 3


def test_a_journal_of_walks_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "walks.jsonl"
    with Journal(path, walking.MADE_OF):
        pass
    Journal(path, walking.MADE_OF).__exit__(None, None, None)
    with pytest.raises(InvalidInputError, match=r"\(code differs\)"):
        Journal(path, {**walking.MADE_OF, "code": "of before"})


def test_scripts_import_their_neighbours_by_their_own_names() -> None:
    for path in FOLDER.glob("*.py"):
        nodes = [] if path.name in AS_MODULES else ast.walk(ast.parse(path.read_text()))
        found = [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
        assert not [name for name in found if name.partition(".")[0] == "benchmarks"], path.name
