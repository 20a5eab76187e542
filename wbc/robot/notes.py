"""Notes of what was tolerated while a robot was loaded, and warnings of them."""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path

from wbc.errors import listed

# Marks warnings that are notes of a robot or a result, too: command lines print those.
NOTED = {"noted": True}
LONG_DELAY = 0.2  # s: errors of a small humanoid that stands triple meanwhile
_enabled = ContextVar("told", default=True)


def noted(words: str, names: Collection[str], most: int = 5) -> tuple[str, ...]:
    """Return a note about names, which stand at ``{}`` in ``words``; none if there are no names."""
    return (words.replace("{}", listed([*names], most)),) if names else ()


def doubt_delay(what: str, seconds: float) -> None:
    """Warn of a delay, called ``what``, that no robot stands with: it may be in ms."""
    if seconds > LONG_DELAY:
        logging.getLogger(__name__).warning("%s; is it in s?", what)


def warn_of(path: Path, notes: Iterable[str]) -> None:
    """Log notes on a robot's file as warnings, each once in a process."""
    if not _enabled.get():
        return
    for note in notes:
        _warn_once(f"{path}: {note}")


@contextmanager
def without_warnings() -> Iterator[None]:
    """Suppress these warnings while loading files that the package wrote itself."""
    before = _enabled.set(False)
    try:
        yield
    finally:
        _enabled.reset(before)


@cache
def _warn_once(text: str) -> None:
    logging.getLogger("wbc.robot").warning("%s", text, extra=NOTED)
