"""Ctrl-C and SIGTERM end a run after the current tick, so that its results are kept."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from wbc.cli.errors import INTERRUPTED


class Interrupts:
    """The signal received, if any; a second Ctrl-C is an ordinary ``KeyboardInterrupt``."""

    def __init__(self) -> None:
        self.signal: int | None = None

    def __call__(self) -> bool:
        """Return whether the run should end; called after every tick."""
        return self.signal is not None

    @property
    def exit_code(self) -> int:
        """The shell's convention: 128 plus the signal's number."""
        return INTERRUPTED if self.signal in (None, signal.SIGINT) else 128 + self.signal

    def note(self, number: int, _: object) -> None:
        """Record a signal."""
        if self.signal is not None and number == signal.SIGINT:
            raise KeyboardInterrupt
        self.signal = number
        if number != signal.SIGINT and signal.getsignal(signal.SIGINT) != self.note:
            signal.raise_signal(signal.SIGINT)  # a search over postures handles Ctrl-C itself


@contextmanager
def noted_interrupts(*, hangup: bool = False) -> Iterator[Interrupts]:
    """Record Ctrl-C and SIGTERM instead of ending at once; with ``hangup`` SIGHUP, too.

    SIGHUP is sent by a closed terminal; if nohup ignores it, it stays ignored.

    Only the main thread receives signals; elsewhere nothing is changed.
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
