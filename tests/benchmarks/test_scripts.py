"""Studies run as scripts: Python then finds what lies beside them, by its own name alone."""

import ast
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"
AS_MODULES = {"mutation.py", "mutation_trials.py"}  # python -m benchmarks.mutation
SCRIPTS = sorted(path.name for path in FOLDER.glob("*.py") if path.name not in AS_MODULES)


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_imports_its_neighbours_by_their_own_names(name: str) -> None:
    tree = ast.parse((FOLDER / name).read_text())
    found = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert not [module for module in found if module.partition(".")[0] == "benchmarks"]
