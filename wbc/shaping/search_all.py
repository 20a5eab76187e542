"""Parallel searches in this and other processes, with a result independent of their number.

This process searches too, so it need not wait until the others have loaded, and continues alone if
one of them dies. When only the others' searches remain, it repeats these: the results are equal,
whichever process is first.
"""

from __future__ import annotations

import pickle
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from wbc.shaping.multi_start import MultiStart
from wbc.shaping.nlp import LocalOptimum, Nlp, Start
from wbc.shaping.outcome import Stopped
from wbc.shaping.separation import searcher
from wbc.workers import Workers

POLL_TIME = 0.05  # s to wait for a result before checking for Ctrl-C


class Searches(NamedTuple):
    """Results by the number of the start, and why the search stopped early, if it did."""

    found: dict[int, LocalOptimum]
    stopped: Stopped | None


def search_all(
    multi_start: MultiStart, nlp: Nlp, others: int, deadline: float | None = None
) -> Searches:
    """Search from every start, here and in other processes; Ctrl-C returns the results so far.

    ``others``: largest number of other processes; see :class:`~wbc.workers.Workers`.
    ``deadline``: by the clock ``time.time``, after which only the first search is started; None:
    none.
    """
    found: dict[int, LocalOptimum] = {}
    starts: list[Start] = []
    waiting: list[int] = []
    pending: set[int] = set()  # given to other processes, without a result

    def record(number: int, local: LocalOptimum) -> None:
        pending.discard(number)
        if number not in found:
            found[number] = local
            multi_start.record(number, local)

    def wanted(number: int) -> bool:
        return multi_start.needs(number) and not (number and _deadline_over(deadline))

    with _searchers(nlp, others) as pool, _noted_interrupt() as interrupt:
        try:
            here = searcher(nlp)
            while True:
                new = multi_start.next_starts()
                waiting += range(len(starts), len(starts) + len(new))
                starts += new
                waiting = [number for number in waiting if wanted(number)]
                mine = waiting[:1] or [number for number in sorted(pending) if wanted(number)][:1]
                waiting = waiting[1:]
                while waiting and others and pool.room:
                    pending.add(number := waiting.pop(0))
                    pool.submit(number, starts[number], deadline if number else None)
                for number in mine:
                    record(number, here.search(starts[number]))
                if not mine and not any(map(multi_start.needs, pending)):
                    break
                if interrupt:
                    raise KeyboardInterrupt
                for answer in pool.results(0.0 if mine else POLL_TIME):
                    number = int(answer.key)  # type: ignore[call-overload]
                    if answer.error is not None:
                        others = 0  # the cause may affect all of them
                        waiting = [number, *waiting] if number in pending else waiting
                    elif answer.value is not None:  # else it was too late
                        record(number, answer.value)
                    pending.discard(number)
        except KeyboardInterrupt:
            return Searches(found, Stopped.INTERRUPTED)
    if len(found) == multi_start.total:
        return Searches(found, None)
    return Searches(found, multi_start.rule.reason or Stopped.SECONDS)


def _deadline_over(deadline: float | None) -> bool:
    return deadline is not None and time.time() > deadline


@contextmanager
def _searchers(nlp: Nlp, count: int) -> Iterator[Workers]:
    """Provide processes that search, each started on first use."""
    with TemporaryDirectory(prefix="wbc-") as folder:
        # A file: what is sent along with the start of a process waits until that has loaded.
        file = Path(folder) / "nlp"
        file.write_bytes(pickle.dumps(nlp) if count else b"")
        with Workers(partial(_make_search, file), count, attempts=1) as pool:
            yield pool


def _make_search(file: Path) -> Callable[[Start, float | None], LocalOptimum | None]:
    """Return a function that searches from a start, unless a deadline is over."""
    one = searcher(pickle.loads(file.read_bytes()))
    return lambda start, deadline: None if _deadline_over(deadline) else one.search(start)


@contextmanager
def _noted_interrupt() -> Iterator[list[int]]:
    """Record Ctrl-C instead of raising: CasADi would take it for a failure of IPOPT.

    Only the main thread receives signals; elsewhere nothing is changed.
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
