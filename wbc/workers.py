"""Worker processes that call a function repeatedly; a dead one is replaced, its call retried."""

from __future__ import annotations

import logging
import os
import pickle
import signal
import threading
from collections import deque
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import connection, get_context, parent_process, resource_tracker
from multiprocessing.process import BaseProcess
from typing import Any, NamedTuple

from wbc.errors import WbcError

ATTEMPTS = 3  # of a call whose processes died, before it is given up
GRACE = 5.0  # s for a process to end by itself

# Makes the function, once in every process: it is pickled, the function need not be.
Make = Callable[[], Callable[..., Any]]


class WorkerDiedError(WbcError):
    """The processes of every attempt at a call have died."""


class Death(NamedTuple):
    """A process that died."""

    key: Hashable  # of its call, None if it had none
    worker: str  # its name and how it died, in words
    attempt: int  # of this call, from 1
    final: bool  # whether the call is not retried


class WorkerAnswer(NamedTuple):
    """What a call returned, or the error it raised; ``worker`` names the process."""

    key: Hashable
    value: Any
    error: Exception | None
    worker: str


@dataclass
class _Job:
    key: Hashable
    arguments: tuple[Any, ...]
    attempt: int = 1


@dataclass
class _Worker:
    process: BaseProcess
    channel: connection.Connection
    job: _Job | None = None

    @property
    def name(self) -> str:
        return f"process {self.process.pid}"


class Workers:
    """Up to ``size`` processes; a context manager that terminates them at its end.

    What the package warns of in them is logged here, each warning once.

    They are started as they are needed, fresh (``spawn``), so a script needs the usual ``if
    __name__ == "__main__"`` guard. Ctrl-C does not reach them, and they end with this process.

    ``make``: makes the function that is called.
    ``on_death``: told of every process that died.
    ``attempts``: how often the same call is tried, if processes die of it.
    """

    def __init__(
        self,
        make: Make,
        size: int,
        on_death: Callable[[Death], object] | None = None,
        attempts: int = ATTEMPTS,
    ) -> None:
        self.size = size
        self._make, self._on_death, self._attempts = make, on_death, attempts
        self._context = get_context("spawn")
        self._workers: list[_Worker] = []
        self._answers: deque[WorkerAnswer] = deque()
        self._warned = set[str]()

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *exception: object) -> None:
        for worker in self._workers:
            worker.process.terminate()
        for worker in self._workers:
            worker.process.join(GRACE)
            if worker.process.is_alive():
                worker.process.kill()
                worker.process.join()
            worker.channel.close()

    @property
    def room(self) -> int:
        """Number of calls that can be submitted now."""
        return self.size - sum(worker.job is not None for worker in self._workers)

    def submit(self, key: Hashable, *arguments: Any) -> None:
        """Let a process call the function; there must be room."""
        self._assign(_Job(key, arguments))

    def results(self, seconds: float) -> list[WorkerAnswer]:
        """Return the available results, waiting at most so long [s] for the first."""
        busy = {worker.channel: worker for worker in self._workers if worker.job is not None}
        ready = connection.wait(list(busy), 0.0 if self._answers else seconds)
        for channel in ready:
            self._receive(busy[channel])  # type: ignore[index]
        found = list(self._answers)
        self._answers.clear()
        return found

    def _receive(self, worker: _Worker) -> None:
        job = worker.job
        assert job is not None  # only those that have one are waited for
        try:
            value, error, warnings = worker.channel.recv()
        except (EOFError, OSError):
            self._remove_dead(worker, job)
            return
        worker.job = None
        for text in warnings:
            if text not in self._warned:
                self._warned.add(text)
                logging.getLogger("wbc").warning("%s", text)
        self._answers.append(WorkerAnswer(job.key, value, error, worker.name))

    def _assign(self, job: _Job) -> None:
        idle = next((one for one in self._workers if one.job is None), None)
        worker = idle or self._start()
        worker.job = job
        try:
            worker.channel.send(job.arguments)
        except OSError:  # it died since its last answer, of something else
            self._notify(Death(None, self._remove(worker), 0, False))
            self._assign(job)

    def _start(self) -> _Worker:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(target=_serve, args=(theirs, self._make))
        with _blocked_interrupt():
            process.start()
        theirs.close()  # so that the end of the process is the end of the channel
        worker = _Worker(process, ours)
        self._workers.append(worker)
        return worker

    def _remove_dead(self, worker: _Worker, job: _Job) -> None:
        """Handle a death: assign the call to another process, or give it up."""
        name = self._remove(worker)
        final = job.attempt >= self._attempts
        self._notify(Death(job.key, name, job.attempt, final))
        if final:
            text = f"a process died each of {job.attempt} times it was tried, last {name}"
            self._answers.append(WorkerAnswer(job.key, None, WorkerDiedError(text), name))
        else:
            self._assign(_Job(job.key, job.arguments, job.attempt + 1))

    def _remove(self, worker: _Worker) -> str:
        """Remove a dead process; return its name and exit reason, in words."""
        self._workers.remove(worker)
        worker.process.join()
        worker.channel.close()
        return f"{worker.name} ({_exit_reason(worker.process.exitcode)})"

    def _notify(self, death: Death) -> None:
        if self._on_death is not None:
            self._on_death(death)


def _exit_reason(exit_code: int | None) -> str:
    """Return how a process ended, in words."""
    if exit_code is None or exit_code >= 0:
        return f"ended with exit code {exit_code}"
    name = signal.Signals(-exit_code).name
    hint = ", perhaps for want of memory" if -exit_code == signal.SIGKILL else ""
    return f"ended by {name}{hint}"


class _Heard(logging.Handler):
    """Collects what the package warns of, but for notes of robots and results."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._warnings = list[str]()

    def emit(self, record: logging.LogRecord) -> None:
        if not getattr(record, "noted", False):
            self._warnings.append(record.getMessage())

    def taken(self) -> list[str]:
        """Return what was collected since the last call."""
        found, self._warnings = self._warnings, []
        return found


def _serve(channel: connection.Connection, make: Make) -> None:
    """Answer calls until the channel is closed: what runs in a process."""
    _end_with_parent()
    logging.getLogger("wbc").addHandler(heard := _Heard())
    function, broken = None, None
    try:
        function = make()
    except WbcError as error:  # told to whoever calls
        broken = _portable(error)
    while True:
        try:
            arguments = channel.recv()
        except EOFError:
            return
        value, wrong = None, broken
        if function is not None:
            try:
                value = function(*arguments)
            except Exception as error:
                wrong = _portable(error)
        warnings = heard.taken()
        try:
            channel.send((value, wrong, warnings))
        except Exception as error:  # a value that cannot be pickled
            channel.send((None, _portable(error), warnings))


def _portable(error: Exception) -> Exception:
    """Return an error that can be pickled: itself, or one with its text."""
    try:
        copy = pickle.loads(pickle.dumps(error))
        if str(copy) == str(error):
            return error
    except Exception:  # whatever its constructor says of being called again
        pass
    kind = WbcError if isinstance(error, WbcError) else RuntimeError
    return kind(str(error) or type(error).__name__)


@contextmanager
def _blocked_interrupt() -> Iterator[None]:
    """Start processes that Ctrl-C does not reach, also not while they load.

    Child processes inherit the blocked signal; in this process it is delivered afterwards.
    """
    resource_tracker.ensure_running()  # which unblocks it where the first process is started
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_parent() -> None:
    """End this process when its parent ends, even if that was killed.

    A pool's processes would otherwise wait for work for ever.
    """
    parent = parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
