"""Run the notebooks of the documentation, and keep their outputs.

    python -m docs.run_notebook docs/notebooks/inertia.ipynb ...

A test runs them, too, and compares the printed text.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import nbclient
import nbformat

SECONDS = 300  # for one cell


def run(path: Path) -> Any:
    """Return a notebook with the outputs of running it in its folder."""
    notebook = nbformat.read(path, as_version=4)
    place = {"metadata": {"path": str(path.parent)}}
    nbclient.NotebookClient(notebook, timeout=SECONDS, resources=place).execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)  # when it ran: another time would be another file
    return notebook


def printed(notebook: Any) -> list[str]:
    """Return the printed text of the cells, without pictures and tables."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    return ["".join(output["text"]) for output in outputs if output["output_type"] == "stream"]


def main(paths: list[str]) -> None:
    """Run each, and write it."""
    for path in map(Path, paths):
        nbformat.write(run(path), path)


if __name__ == "__main__":
    main(sys.argv[1:])
