"""Many searches at once, in this process and in those of a :mod:`concurrent.futures` pool.

This process searches too, so it need not wait until the others have loaded, and goes on alone, with
the same answer, if one of them dies. New starts may be made of what was found; the others get them
as they are made.
"""

from __future__ import annotations

import pickle
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from wbc.errors import WbcError
from wbc.processes import blocked_interrupt, terminate
from wbc.shaping.multi_start import MultiStart
from wbc.shaping.nlp import Ipopt, Local, Nlp, Start
from wbc.shaping.outcome import Stopped
from wbc.shaping.separation import SeparatedIpopt, searcher

MOMENT = 0.05  # s to wait for a result, before looking whether Ctrl-C was pressed
AHEAD = 2  # searches that each process has been given, so that none waits for this one


class Searches(NamedTuple):
    """Results by the number of the start, and why some are missing."""

    found: dict[int, Local]
    stopped: Stopped | None


class WorkerPool:
    """Processes that search; a context, at whose end they are terminated.

    They are started fresh (``spawn``), so a script that asks for any needs the usual ``if __name__
    == "__main__"`` guard: without it they end with Python's message that says so.

    Parameters
    ----------
    size:
        How many others there are; with none the one that asks searches alone.
    deadline:
        Of the clock ``time.time``, after which nobody begins another search than the first; None:
        there is none.
    """

    def __init__(self, nlp: Nlp, size: int, deadline: float | None) -> None:
        self.nlp, self._deadline, self._capacity = nlp, deadline, AHEAD * size
        self._pending: dict[Future[Local | None], int] = {}
        self._pool: ProcessPoolExecutor | None = None
        if size:
            self._folder = TemporaryDirectory(prefix="wbc-")
            # A file: what is sent along with the start of a process waits until that has loaded.
            file = Path(self._folder.name) / "nlp"
            file.write_bytes(pickle.dumps(nlp))
            self._pool = ProcessPoolExecutor(size, get_context("spawn"), _load, (file,))
            self._loading = [self._begin(_nothing) for _ in range(size)]

    def __enter__(self) -> WorkerPool:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._pool is None:
            return
        terminate(self._pool)
        self._folder.cleanup()

    def late(self, number: int) -> bool:
        """Return whether it is too late to begin the search of a number."""
        return number > 0 and self._deadline is not None and time.time() > self._deadline

    def has_room(self) -> bool:
        """Return whether another process has loaded, and has little to do."""
        return len(self._pending) < self._capacity and any(one.done() for one in self._loading)

    def submit(self, number: int, start: Start) -> bool:
        """Let another process search from a start; return False if they have died."""
        deadline = self._deadline if number > 0 else None
        try:
            self._pending[self._begin(_search, start, deadline)] = number
        except BrokenProcessPool:
            self._capacity = 0
        return self._capacity > 0

    def take_back(self) -> int | None:
        """Return the number of a search that no process has begun, which none then does."""
        for future, number in self._pending.items():
            if future.cancel():
                del self._pending[future]
                return number
        return None

    def waits_for(self, needs: Callable[[int], bool]) -> bool:
        """Return whether the others have yet to finish a search that is needed."""
        return any(needs(number) for number in self._pending.values())

    def results(self, patient: bool) -> tuple[list[tuple[int, Local]], list[int]]:
        """Return what the others have found meanwhile, and the numbers of searches that were lost.

        If ``patient``, wait a moment for the first.
        """
        done = wait(self._pending, MOMENT if patient else 0.0, FIRST_COMPLETED).done
        found: list[tuple[int, Local]] = []
        lost: list[int] = []
        for future in sorted(done, key=self._pending.__getitem__):
            number = self._pending.pop(future)
            try:
                local = future.result()
            except BrokenProcessPool:
                self._capacity = 0
                lost.append(number)
                continue
            if local is not None:  # else it was too late
                found.append((number, local))
        return found, lost

    def _begin(self, function: Callable[..., Any], *arguments: object) -> Future[Any]:
        if self._pool is None:
            raise WbcError("global shaping: a search was submitted to a pool without workers")
        with blocked_interrupt():  # this may start processes
            return self._pool.submit(function, *arguments)


def search_all(multi_start: MultiStart, pool: WorkerPool) -> Searches:
    """Search from every start, here and by a pool; Ctrl-C ends it with the results so far.

    The first start is always searched from, others until the pool's time is over.
    """
    found: dict[int, Local] = {}
    starts: list[Start] = []
    waiting: list[int] = []

    def record(number: int, local: Local) -> None:
        found[number] = local
        multi_start.record(number, local)

    with _noted_interrupt() as interrupt:
        try:
            here = searcher(pool.nlp)
            while True:
                new = multi_start.next_starts()
                waiting += range(len(starts), len(starts) + len(new))
                starts += new
                waiting = [k for k in waiting if multi_start.needs(k) and not pool.late(k)]
                number = waiting.pop(0) if waiting else pool.take_back()
                while waiting and pool.has_room() and pool.submit(waiting[0], starts[waiting[0]]):
                    del waiting[0]
                if number is not None:
                    record(number, here.search(starts[number]))
                elif not pool.waits_for(multi_start.needs):
                    break
                if interrupt:
                    raise KeyboardInterrupt
                results, lost = pool.results(patient=number is None)
                for result in results:
                    record(*result)
                waiting = [*lost, *waiting]
        except KeyboardInterrupt:
            return Searches(found, Stopped.INTERRUPTED)
    if len(found) == multi_start.total:
        return Searches(found, None)
    return Searches(found, multi_start.reason or Stopped.SECONDS)


_loaded: list[Ipopt | SeparatedIpopt] = []  # what searches, in a process of the pool


def _load(file: Path) -> None:
    _loaded.append(searcher(pickle.loads(file.read_bytes())))


def _nothing() -> None:
    """Do nothing: it is done when a process has loaded."""


def _search(start: Start, deadline: float | None) -> Local | None:
    """Return where the search from a start ends, None after the deadline."""
    late = deadline is not None and time.time() > deadline
    return None if late else _loaded[0].search(start)


@contextmanager
def _noted_interrupt() -> Iterator[list[int]]:
    """Note Ctrl-C instead of raising: inside a search CasADi takes that for a failure of IPOPT.

    Only the main thread can be told of signals; elsewhere they are left to it.
    """
    noted: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield noted
        return
    before = signal.signal(signal.SIGINT, lambda number, _: noted.append(number))
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, before or signal.SIG_DFL)
