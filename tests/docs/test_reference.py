"""The reference of the Python interface has every public name."""

import re
from pathlib import Path

import wbc

FOLDER = Path(__file__).parents[2] / "docs" / "reference"
# Rooms, and what is on the page of errors as a whole.
ELSEWHERE = {"__version__", "WbcError", "gait", "simulation", "view"}


def test_every_public_name_is_there() -> None:
    pages = "".join(path.read_text(encoding="utf-8") for path in FOLDER.glob("*.md"))
    shown = re.findall(r"^::: ([\w.]+)$", pages, flags=re.MULTILINE)
    assert len(shown) == len(set(shown))
    missing = set(wbc.__all__) - ELSEWHERE - {name.rpartition(".")[2] for name in shown}
    assert not missing, f"add '::: wbc.NAME' to a page of docs/reference for {sorted(missing)}"
