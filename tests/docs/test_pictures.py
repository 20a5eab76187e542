"""The program that makes the pictures of README and gallery."""

from pathlib import Path

from docs.make_pictures import PICTURES

FOLDER = Path(__file__).parents[2] / "docs" / "pictures"


def test_all_pictures_that_can_be_made_are_there() -> None:
    """Importing it says, too, that all the functions of studies that it calls are there."""
    assert not [name for name in PICTURES if not (FOLDER / f"{name}.png").exists()]
