"""What was tolerated while a robot was loaded, told where it is loaded."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from functools import cache
from pathlib import Path


def warn_of(path: Path, notes: Iterable[str]) -> None:
    """Log notes on a robot's file as warnings, each once in a process."""
    for note in notes:
        _warn_once(f"{path}: {note}")


@cache
def _warn_once(text: str) -> None:
    logging.getLogger("wbc.robot").warning("%s", text)
