"""Processes that work for this one: Ctrl-C does not reach them, and they do not outlive it."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import parent_process


@contextmanager
def blocked_interrupt() -> Iterator[None]:
    """Start processes that Ctrl-C does not reach, also not while they load.

    A blocked signal stays blocked in what is started; here it waits until it no longer is.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_with_parent() -> None:
    """Let this process end when the one that started it does, even if that was killed.

    A pool's processes would otherwise wait for work for ever.
    """
    parent = parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
