"""A process that looks at the log while the loop fills it: whatever it does, no cycle waits."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable

from wbc.hardware.real_time import ordinary_priority
from wbc.hardware.ring_log import RingLog


class Watcher:
    """Calls a function with the ring in a process that is forked now.

    Parameters
    ----------
    watch:
        Returns when it likes; it is ended with the loop.
    """

    def __init__(self, ring: RingLog, watch: Callable[[RingLog], None]) -> None:
        context = multiprocessing.get_context("fork")
        self._process = context.Process(target=_watch, args=(ring, watch), name="watch")
        self._process.start()

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.join()


def _watch(ring: RingLog, watch: Callable[[RingLog], None]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the terminal: the loop decides what it means
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    ordinary_priority()
    watch(ring)
