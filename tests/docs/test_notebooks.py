"""Notebooks of the documentation run and print what they show; the maker of pictures is found."""

from pathlib import Path

import pytest

from docs.make_pictures import PICTURES

DOCS = Path(__file__).resolve().parents[2] / "docs"
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))
FOLDER = Path(__file__).parents[2] / "docs" / "pictures"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Jupyter's own packages
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_prints_what_it_shows(path: Path) -> None:
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("nbclient")
    from docs.run_notebook import printed, run

    assert printed(run(path)) == printed(nbformat.read(path, as_version=4))


def test_there_are_notebooks_and_none_is_large() -> None:
    assert NOTEBOOKS and max(path.stat().st_size for path in NOTEBOOKS) < 300_000


def test_all_pictures_that_can_be_made_are_there() -> None:
    """Importing it says, too, that all the functions of studies that it calls are there."""
    assert not [name for name in PICTURES if not (FOLDER / f"{name}.png").exists()]
