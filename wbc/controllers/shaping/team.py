"""The other processes that search, and the board from which all take the next start."""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Container, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnContext
from typing import Any

from wbc.controllers.shaping.nlp import Local, Nlp, Start

MOMENT = 0.05  # s to wait for an answer, before looking whether Ctrl-C was pressed
NEXT, READY, HELD = 0, 1, 2  # cells of the board; from HELD on one for each process
NOTHING = -1  # held


class Team:
    """Processes that search; a context, at whose end they are dismissed.

    They are started fresh (``spawn``), so a script that asks for any needs the usual ``if __name__
    == "__main__"`` guard.

    Parameters
    ----------
    size:
        How many others there are; with none the one that asks searches alone.
    deadline:
        Of the clock ``time.time``, after which nobody begins another search than the first; None:
        there is none.
    """

    def __init__(self, nlp: Nlp, size: int, deadline: float | None) -> None:
        context = multiprocessing.get_context("spawn")
        self._board = _Board(context, size + 1, deadline)
        self._starts: list[Start] = []
        self._taken: int | None = None  # how many starts had been begun when enough was found
        self._members = [_Member(context, self._board, k + 1, nlp) for k in range(size)]

    def __enter__(self) -> Team:
        return self

    def __exit__(self, *exception: object) -> None:
        for member in self._members:
            member.dismiss()

    def offer(self, starts: Sequence[Start]) -> None:
        """Let everybody take these starts too, which are numbered on."""
        if not starts or self._taken is not None:
            return
        self._starts.extend(starts)
        # Before they are sent: who is woken by them, and finds none ready, would wait for the next.
        self._board.make_ready(len(self._starts))
        for member in self._members:
            member.post(list(starts))

    def start(self, number: int) -> Start:
        """Return the start of a number."""
        return self._starts[number]

    def take(self) -> int | None:
        """Return the number of the next start, for this process; None if there is none now."""
        return self._board.take(0)

    @property
    def taken(self) -> int:
        """How many starts, the first ones, somebody has taken."""
        return self._board.taken() if self._taken is None else self._taken

    def begin_no_more(self) -> None:
        """Let nobody take another start; what is under way is finished."""
        if self._taken is None:
            self._taken = self._board.close()

    def lost(self, found: Container[int]) -> list[int]:
        """Return numbers that somebody took, nobody has answered and nobody is searching from.

        An answer is sent before the next start is taken; so if nobody holds a number any more, its
        answer is already here, and is to be read before it counts as lost.
        """
        held = self._board.held([0, *(m.number for m in self._members if m.alive)])
        missing = [n for n in range(self.taken) if n not in found and n not in held]
        return [] if any(member.answered for member in self._members) else missing

    def results(self, wait_for_one: bool = False) -> list[tuple[int, Local]]:
        """Return what the others have found meanwhile; wait a moment for the first if told to."""
        alive = [member.channel for member in self._members if member.alive]
        ready = set(wait(alive, MOMENT if wait_for_one else 0.0)) if alive else set()
        found: list[tuple[int, Local]] = []
        for member in self._members:
            if member.channel in ready:
                found += member.answers()
        return found


class _Board:
    """What all processes share: the next start's number, how many are ready, who has which."""

    def __init__(self, context: SpawnContext, processes: int, deadline: float | None) -> None:
        self._cells: Any = context.Array("q", [0, 0, *[NOTHING] * processes])
        self._deadline = deadline

    def take(self, process: int) -> int | None:
        """Take the next number, or None when none is ready or the time is over."""
        with self._cells.get_lock():
            number = int(self._cells[NEXT])
            late = self._deadline is not None and number > 0 and time.time() > self._deadline
            if number >= self._cells[READY] or late:
                self._cells[HELD + process] = NOTHING
                return None
            self._cells[NEXT] = number + 1
            self._cells[HELD + process] = number
            return number

    def make_ready(self, count: int) -> None:
        """Let the first ``count`` starts be taken."""
        with self._cells.get_lock():
            self._cells[READY] = count

    def close(self) -> int:
        """Let no more be taken, and return how many were."""
        with self._cells.get_lock():
            self._cells[READY] = 0
            return int(self._cells[NEXT])

    def taken(self) -> int:
        """Return how many were taken."""
        return int(self._cells[NEXT])

    def held(self, processes: Sequence[int]) -> set[int]:
        """Return the numbers that these processes are searching from."""
        with self._cells.get_lock():
            return {int(self._cells[HELD + k]) for k in processes}


class _Member:
    """Another process, seen from here."""

    def __init__(self, context: SpawnContext, board: _Board, number: int, nlp: Nlp) -> None:
        self.number = number
        self.alive = True
        self.channel, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs, board, number), daemon=True)
        with _deaf_to_ctrl_c():
            self._process.start()
            # A thread of its own: what is sent must be read by a process that is still loading.
            self._mail = ThreadPoolExecutor(1)
            self.post(nlp)
        theirs.close()  # so that an end of the process is an end of the channel

    def post(self, what: Nlp | list[Start]) -> None:
        """Send something, in the order of calls; a process that has died does not get it."""
        self._mail.submit(self.channel.send, what)

    @property
    def answered(self) -> bool:
        """True if there is something to read, be it that the process has ended."""
        return self.alive and self.channel.poll()

    def answers(self) -> list[tuple[int, Local]]:
        """Return what it has found and sent."""
        found = []
        try:
            while self.answered:
                found.append(self.channel.recv())
        except (EOFError, OSError):
            self.alive = False
        return found

    def dismiss(self) -> None:
        """End the process at once, be it loading or searching."""
        self._process.terminate()
        self._process.join()
        self._mail.shutdown(cancel_futures=True)  # nobody is left to read what was not sent yet
        self.channel.close()


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


def _work(channel: Connection, board: _Board, number: int) -> None:
    """Search until dismissed: what the other processes do.

    Ctrl-C is answered by the first process; see :func:`_deaf_to_ctrl_c`.
    """
    try:
        searcher = channel.recv().searcher()
        starts: list[Start] = []
        while True:
            taken = board.take(number)
            while taken is None or taken >= len(starts):
                starts += channel.recv()
                if taken is None:
                    taken = board.take(number)
            channel.send((taken, searcher.search(starts[taken])))
    except (EOFError, OSError):  # the first process is no more
        return
