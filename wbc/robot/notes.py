"""What was tolerated while a robot was loaded, told where it is loaded."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path

_told = ContextVar("told", default=True)


def warn_of(path: Path, notes: Iterable[str]) -> None:
    """Log notes on a robot's file as warnings, each once in a process."""
    if not _told.get():
        return
    for note in notes:
        _warn_once(f"{path}: {note}")


@contextmanager
def untold() -> Iterator[None]:
    """Keep notes from being logged: they are for those who wrote a file, not of one we made."""
    before = _told.set(False)
    try:
        yield
    finally:
        _told.reset(before)


@cache
def _warn_once(text: str) -> None:
    logging.getLogger("wbc.robot").warning("%s", text)
