"""Ctrl-C and SIGTERM end a run after the tick at hand, so that what was computed is kept."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from wbc.cli.errors import INTERRUPTED, TERMINATED


class Interrupts:
    """Which signal came, if one did; a second Ctrl-C is an ordinary ``KeyboardInterrupt``."""

    def __init__(self) -> None:
        self.signal: int | None = None

    def __call__(self) -> bool:
        """Return whether the run is to end: what a run asks after every tick."""
        return self.signal is not None

    @property
    def exit_code(self) -> int:
        """As a shell has it: 128 and the signal's number."""
        return TERMINATED if self.signal == signal.SIGTERM else INTERRUPTED

    def note(self, number: int, _: object) -> None:
        """Take note of a signal."""
        if self.signal is not None and number == signal.SIGINT:
            raise KeyboardInterrupt
        self.signal = number
        if number == signal.SIGTERM and signal.getsignal(signal.SIGINT) != self.note:
            signal.raise_signal(signal.SIGINT)  # a search over postures has its own ear for Ctrl-C


@contextmanager
def noted_interrupts() -> Iterator[Interrupts]:
    """Note Ctrl-C and SIGTERM instead of obeying them at once.

    Only the main thread can be told of signals; elsewhere they are left to it.
    """
    noted = Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield noted
        return
    both = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, noted.note) for number in both]
    try:
        yield noted
    finally:
        for number, handler in zip(both, before, strict=True):
            signal.signal(number, handler or signal.SIG_DFL)
