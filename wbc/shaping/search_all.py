"""Many searches at once, in this process and in others: one answer, however many there are.

This process searches too, so it need not wait until the others have loaded, and goes on alone if
one of them dies. Where only searches of the others are left, it makes these as well: whoever comes
first, they end alike.
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
from wbc.shaping.nlp import Local, Nlp, Start
from wbc.shaping.outcome import Stopped
from wbc.shaping.separation import searcher
from wbc.workers import Workers

MOMENT = 0.05  # s to wait for a result, before looking whether Ctrl-C was pressed


class Searches(NamedTuple):
    """Results by the number of the start, and why some are missing."""

    found: dict[int, Local]
    stopped: Stopped | None


def search_all(
    multi_start: MultiStart, nlp: Nlp, others: int, deadline: float | None = None
) -> Searches:
    """Search from every start, here and in other processes; Ctrl-C ends it with what was found.

    Parameters
    ----------
    others:
        How many other processes there are at most; see :class:`~wbc.workers.Workers`.
    deadline:
        Of the clock ``time.time``, after which nobody begins another search than the first; None:
        there is none.
    """
    found: dict[int, Local] = {}
    starts: list[Start] = []
    waiting: list[int] = []
    asked: set[int] = set()  # of the others, and not yet answered

    def record(number: int, local: Local) -> None:
        asked.discard(number)
        if number not in found:
            found[number] = local
            multi_start.record(number, local)

    def wanted(number: int) -> bool:
        return multi_start.needs(number) and not (number and _is_over(deadline))

    with _searchers(nlp, others) as pool, _noted_interrupt() as interrupt:
        try:
            here = searcher(nlp)
            while True:
                new = multi_start.next_starts()
                waiting += range(len(starts), len(starts) + len(new))
                starts += new
                waiting = [number for number in waiting if wanted(number)]
                mine = waiting[:1] or [number for number in sorted(asked) if wanted(number)][:1]
                waiting = waiting[1:]
                while waiting and others and pool.room:
                    asked.add(number := waiting.pop(0))
                    pool.submit(number, starts[number], deadline if number else None)
                for number in mine:
                    record(number, here.search(starts[number]))
                if not mine and not any(map(multi_start.needs, asked)):
                    break
                if interrupt:
                    raise KeyboardInterrupt
                for answer in pool.results(0.0 if mine else MOMENT):
                    number = int(answer.key)  # type: ignore[call-overload]
                    if answer.error is not None:
                        others = 0  # what one of them died of, others may
                        waiting = [number, *waiting] if number in asked else waiting
                    elif answer.value is not None:  # else it was too late
                        record(number, answer.value)
                    asked.discard(number)
        except KeyboardInterrupt:
            return Searches(found, Stopped.INTERRUPTED)
    if len(found) == multi_start.total:
        return Searches(found, None)
    return Searches(found, multi_start.rule.reason or Stopped.SECONDS)


def _is_over(deadline: float | None) -> bool:
    return deadline is not None and time.time() > deadline


@contextmanager
def _searchers(nlp: Nlp, count: int) -> Iterator[Workers]:
    """Give processes that search, each started when it is first asked."""
    with TemporaryDirectory(prefix="wbc-") as folder:
        # A file: what is sent along with the start of a process waits until that has loaded.
        file = Path(folder) / "nlp"
        file.write_bytes(pickle.dumps(nlp) if count else b"")
        with Workers(partial(_search_of, file), count, attempts=1) as pool:
            yield pool


def _search_of(file: Path) -> Callable[[Start, float | None], Local | None]:
    """Return what searches from a start, unless a deadline is over."""
    one = searcher(pickle.loads(file.read_bytes()))
    return lambda start, deadline: None if _is_over(deadline) else one.search(start)


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
