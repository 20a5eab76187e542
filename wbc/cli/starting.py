"""What a command is doing before it has anything to show: said where it takes over a second."""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import typer

SECONDS = 1.0  # that one waits without a word
DOING = "wbc.doing"  # the logger to which the library says what takes long


class _Told(logging.Handler):
    """Prints the last thing that was said once the time is over, and from then on all."""

    def __init__(self, first: str) -> None:
        super().__init__(logging.INFO)
        self._last, self._late, self._guard = first, False, threading.Lock()

    def emit(self, record: logging.LogRecord) -> None:
        with self._guard:
            self._last = record.getMessage()
            if self._late:
                _say(self._last)

    def be_late(self) -> None:
        """Say what is being done, and from now on whatever comes."""
        with self._guard:
            self._late = True
            _say(self._last)


def is_watched() -> bool:
    """Whether somebody waits at a terminal."""
    return sys.stderr.isatty()


def _say(text: str) -> None:
    typer.echo(f"{text} ...", err=True)


@contextmanager
def starting(what: str, quiet: bool = False) -> Iterator[None]:
    """Say what is done meanwhile on the terminal, if there is one and it takes over a second.

    Parameters
    ----------
    what:
        What begins, such as ``"loading p.yaml"``; the library says the rest as it comes to it.
    """
    if quiet or not is_watched():
        yield
        return
    told, logger = _Told(what), logging.getLogger(DOING)
    timer = threading.Timer(SECONDS, told.be_late)
    timer.daemon = True
    level, propagates = logger.level, logger.propagate
    logger.setLevel(logging.INFO)
    logger.addHandler(told)
    logger.propagate = False
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        logger.removeHandler(told)
        logger.setLevel(level)
        logger.propagate = propagates
