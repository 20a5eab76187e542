"""Ctrl-C and SIGTERM end a run after the tick at hand, so that what was computed is kept."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from wbc.cli.errors import INTERRUPTED


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
        return INTERRUPTED if self.signal in (None, signal.SIGINT) else 128 + self.signal

    def note(self, number: int, _: object) -> None:
        """Take note of a signal."""
        if self.signal is not None and number == signal.SIGINT:
            raise KeyboardInterrupt
        self.signal = number
        if number != signal.SIGINT and signal.getsignal(signal.SIGINT) != self.note:
            signal.raise_signal(signal.SIGINT)  # a search over postures has its own ear for Ctrl-C


@contextmanager
def noted_interrupts(*, hangup: bool = False) -> Iterator[Interrupts]:
    """Note Ctrl-C and SIGTERM instead of obeying them at once; with ``hangup`` SIGHUP, too.

    That is what a terminal sends that is gone; where nohup ignores it it stays ignored.

    Only the main thread can be told of signals; elsewhere they are left to it.
    """
    noted = Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield noted
        return
    numbers = [signal.SIGINT, signal.SIGTERM]
    gone = getattr(signal, "SIGHUP", None)
    if hangup and gone is not None and signal.getsignal(gone) != signal.SIG_IGN:
        numbers.append(gone)
    before = [signal.signal(number, noted.note) for number in numbers]
    try:
        yield noted
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler or signal.SIG_DFL)
