"""Many searches at once, in this process and in others.

Every process takes the next start when it is done with one, this process among them: it need not
wait until others have loaded, and a process that dies loses one search, which is repeated here.
"""

from __future__ import annotations

import multiprocessing
import queue
import signal
import threading
import time
from collections.abc import Callable, Container, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from wbc.controllers.shaping.nlp import Local, Nlp, Start
from wbc.controllers.shaping.outcome import Stopped

# Called with the number of a start and what was found from it; True if no more are needed.
Report = Callable[[int, Local], bool]
PATIENCE = 0.05  # s between looks at whether a process is still alive


@dataclass(frozen=True, eq=False)
class Searches:
    """Results by the number of the start, and why some are missing."""

    found: dict[int, Local]
    stopped: Stopped | None


def search_all(
    nlp: Nlp,
    starts: Sequence[Start],
    workers: int,
    seconds: float | None,
    report: Report,
) -> Searches:
    """Search from every start.

    Parameters
    ----------
    workers:
        Processes, this one included. Others are started fresh (``spawn``), so a script that asks
        for more than one needs the usual ``if __name__ == "__main__"`` guard.
    seconds:
        Wall time after which no search is begun, and how long a single one may take (at least a
        second), or None. The first start is always searched from.
    report:
        Called in this process after each search; returns True when no more need be begun.
    """
    deadline = None if seconds is None else time.time() + seconds
    if seconds is not None:
        nlp = nlp.within(max(seconds, 1.0))
    found: dict[int, Local] = {}

    def note(number: int, local: Local) -> None:
        found[number] = local
        if report(number, local):
            team.begin_no_more()

    team = _Team(nlp, starts, min(workers, len(starts)) - 1, deadline)
    with _Interruption() as interruption:
        try:
            searcher = nlp.searcher()
            for number in iter(team.next_start, None):
                note(number, searcher.search(starts[number]))
                interruption.check()
                for result in team.results():
                    note(*result)
            while team.missing(found) and team.busy():
                interruption.check()
                for result in team.results(PATIENCE):
                    note(*result)
            for number in team.missing(found):  # taken by a process that died
                note(number, searcher.search(starts[number]))
        except KeyboardInterrupt:
            return Searches(found, Stopped.INTERRUPTED)
        finally:
            team.dismiss()
    if len(found) == len(starts):
        return Searches(found, None)
    return Searches(found, Stopped.MET if team.enough else Stopped.SECONDS)


class _Interruption:
    """Keeps Ctrl-C until it is asked for.

    Inside a search CasADi turns the exception into a failure of IPOPT and goes on. Only the main
    thread can be told of signals; elsewhere they are left to it.
    """

    def __init__(self) -> None:
        self._pressed = False
        self._before: Any = None

    def __enter__(self) -> _Interruption:
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._press)
        return self

    def __exit__(self, *exception: object) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _press(self, *signal_and_frame: object) -> None:
        self._pressed = True

    def check(self) -> None:
        """Raise KeyboardInterrupt if Ctrl-C was pressed."""
        if self._pressed:
            raise KeyboardInterrupt


class _Team:
    """The other processes, and the counter from which all take the next start."""

    def __init__(
        self, nlp: Nlp, starts: Sequence[Start], size: int, deadline: float | None
    ) -> None:
        context = multiprocessing.get_context("spawn")
        self._counter: Any = context.Value("i", 0)
        self._answers: Any = context.Queue()
        self._tasks: Any = context.Queue()
        self._count, self._deadline = len(starts), deadline
        self._taken: int | None = None  # how many starts had been begun when enough was found
        shared = (self._tasks, self._counter, self._answers)
        self._members = [
            context.Process(target=_work, args=shared, daemon=True) for _ in range(max(size, 0))
        ]
        for member in self._members:
            with _deaf_to_ctrl_c():
                member.start()
            # Through a queue, whose own thread sends it: as an argument it would have to be read
            # by a process that is still loading before this one could go on.
            self._tasks.put((nlp, list(starts), deadline))

    def next_start(self) -> int | None:
        """Return the number of the next start for this process."""
        return _next(self._counter, self._count, self._deadline)

    def missing(self, found: Container[int]) -> list[int]:
        """Return the numbers that somebody has taken and nobody has answered."""
        taken = self._counter.value if self._taken is None else self._taken
        return [number for number in range(taken) if number not in found]

    @property
    def enough(self) -> bool:
        """True once no more are begun because enough was found."""
        return self._taken is not None

    def begin_no_more(self) -> None:
        """Let nobody take another start; what is under way is finished."""
        with self._counter.get_lock():
            if self._taken is None:
                self._taken = int(self._counter.value)
                self._counter.value = self._count

    def busy(self) -> bool:
        """Return True if an answer may still come: a process lives, or its answer is on the way."""
        return any(member.is_alive() for member in self._members) or not self._answers.empty()

    def results(self, patience: float = 0.0) -> list[tuple[int, Local]]:
        """Return what the others have found meanwhile; wait ``patience`` [s] for the first."""
        found = []
        try:
            found.append(self._answers.get(timeout=patience))
            while True:
                found.append(self._answers.get_nowait())
        except queue.Empty:
            return found

    def dismiss(self) -> None:
        """End the other processes; those that are still loading, or were interrupted, at once."""
        for member in self._members:
            member.terminate()
            member.join()
        for channel in (self._tasks, self._answers):
            channel.close()
            channel.cancel_join_thread()  # nobody is left to read what was not sent yet


@contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Start processes that Ctrl-C does not reach, also not while they load.

    A blocked signal stays blocked in what is started; here it waits until it no longer is.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _next(counter: Any, count: int, deadline: float | None) -> int | None:
    """Take the next number, or None when there is none or the time is over."""
    with counter.get_lock():
        number = int(counter.value)
        late = deadline is not None and number > 0 and time.time() > deadline
        if number >= count or late:
            return None
        counter.value = number + 1
        return number


def _work(tasks: Any, counter: Any, answers: Any) -> None:
    """Search until there is no start left: what the other processes do.

    Ctrl-C is answered by the first process; see :func:`_deaf_to_ctrl_c`.
    """
    nlp, starts, deadline = tasks.get()
    searcher = nlp.searcher()
    for number in iter(lambda: _next(counter, len(starts), deadline), None):
        answers.put((number, searcher.search(starts[number])))
