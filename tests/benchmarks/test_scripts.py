"""Studies run as scripts: Python then finds what lies beside them, by its own name alone."""

import ast
from pathlib import Path

FOLDER = Path(__file__).parents[2] / "benchmarks"
AS_MODULES = {"mutation.py", "mutation_trials.py"}  # python -m benchmarks.mutation


def test_scripts_import_their_neighbours_by_their_own_names() -> None:
    for path in FOLDER.glob("*.py"):
        nodes = [] if path.name in AS_MODULES else ast.walk(ast.parse(path.read_text()))
        found = [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
        assert not [name for name in found if name.partition(".")[0] == "benchmarks"], path.name
