"""What a command is doing before it has anything to show, where somebody waits at a terminal."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.status import Status

DOING = "wbc.doing"  # the logger to which the library says what takes long


class _Told(logging.Handler):
    """Shows the last thing that was said."""

    def __init__(self, status: Status) -> None:
        super().__init__(logging.INFO)
        self._status = status

    def emit(self, record: logging.LogRecord) -> None:
        self._status.update(f"{record.getMessage()} ...")


@contextmanager
def starting(what: str, quiet: bool = False) -> Iterator[None]:
    """Say what is done meanwhile on the terminal, if there is one.

    Parameters
    ----------
    what:
        What begins, such as ``"loading p.yaml"``; the library says the rest as it comes to it.
    """
    console, logger = Console(stderr=True, highlight=False), logging.getLogger(DOING)
    if quiet or not console.is_terminal:
        yield
        return
    level, propagates = logger.level, logger.propagate
    with console.status(f"{what} ...") as status:
        told = _Told(status)
        logger.setLevel(logging.INFO)
        logger.addHandler(told)
        logger.propagate = False
        try:
            yield
        finally:
            logger.removeHandler(told)
            logger.setLevel(level)
            logger.propagate = propagates
