"""Runs on a cluster of Dask distributed: the same interface as :class:`wbc.workers.Workers`.

The scheduler gives the runs of a worker that is gone to others, and gives a run up that has killed
several. Workers may come and go; a worker's threads run one at a time.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Hashable, Mapping
from typing import Any

from wbc.batch.row import made_with, run_row
from wbc.errors import WbcError
from wbc.extras import require
from wbc.workers import Death, WorkerAnswer, WorkerDiedError

AHEAD = 2  # runs that each thread of the cluster has been given, so that none waits for this one
LOOK = 1.0  # s between looks at who is there
CONNECT = 20.0  # s to wait for the scheduler


class Cluster:
    """The workers of a scheduler; a context, at whose end what is not done is cancelled.

    ``address``: such as ``tcp://10.0.0.1:8786``; ``on_death``: told of every worker that is gone,
    once for each run that it was last seen with.

    Raises MissingPackageError: Dask distributed is not installed; WbcError: no scheduler is there,
    it has no workers, or one has other versions than this process.
    """

    def __init__(self, address: str, on_death: Callable[[Death], object] | None = None) -> None:
        require("distributed", "--cluster")
        from distributed import Client
        from distributed.comm import get_address_host_port

        self.address = address
        self._on_death = on_death or (lambda death: None)
        try:
            if not address.startswith("inproc://"):
                get_address_host_port(address)  # a client that fails of it hangs on for 40 s
            self._client = Client(address, timeout=CONNECT, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise WbcError(f"--cluster {address}: no scheduler answers: {error}") from error
        self._names: dict[str, Hashable] = {}  # of keys of Dask
        self._futures: dict[Hashable, Any] = {}
        self._done: queue.Queue[tuple[Hashable, Any]] = queue.Queue()
        self._processing: Mapping[str, tuple[str, ...]] = {}
        self._looked = 0.0
        try:
            self._check_versions()
            self._look()
        except BaseException:
            self._client.close()
            raise

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        try:
            if kind is None:
                self._look()
            self._client.cancel(list(self._futures.values()), force=True)
        finally:
            self._client.close()

    @property
    def room(self) -> int:
        """How many runs can be submitted now."""
        return max(1, AHEAD * self._threads) - len(self._futures)

    def submit(self, key: Hashable, *arguments: Any) -> None:
        """Let the cluster call :func:`~wbc.batch.row.run_row`."""
        name = f"wbc-{id(self):x}-{key}"
        future = self._client.submit(run_row, *arguments, key=name, pure=False)
        self._names[name], self._futures[key] = key, future
        future.add_done_callback(lambda done: self._done.put((key, done)))

    def results(self, seconds: float) -> list[WorkerAnswer]:
        """Return what has come, after waiting for the first at most so long."""
        found = []
        try:
            found.append(self._answer(*self._done.get(timeout=seconds)))
            while True:
                found.append(self._answer(*self._done.get_nowait()))
        except queue.Empty:
            pass
        if time.monotonic() - self._looked > LOOK:
            self._look()
        return found

    def _answer(self, key: Hashable, future: Any) -> WorkerAnswer:
        from distributed import KilledWorker

        del self._futures[key]
        error = future.exception() if future.status == "error" else None
        if future.status in ("cancelled", "lost"):
            raise WbcError(f"--cluster {self.address}: the scheduler has dropped the runs")
        if isinstance(error, KilledWorker):
            last = getattr(error.last_worker, "address", "unknown")
            text = f"workers died each time it was tried, last {last}"
            return WorkerAnswer(key, None, WorkerDiedError(text), last)
        value = future.result() if error is None else None
        return WorkerAnswer(key, value, error, "" if value is None else value["worker"])

    def _look(self) -> None:
        """Update which workers are there, at which runs, and report those that are gone."""
        self._looked = time.monotonic()
        try:
            info = self._client.scheduler_info(n_workers=-1)["workers"]
            processing = self._client.processing()
        except (OSError, TimeoutError) as error:
            raise WbcError(f"--cluster {self.address}: the scheduler is gone: {error}") from error
        self._threads = sum(worker["nthreads"] for worker in info.values())
        for worker, names in self._processing.items():
            if worker not in info:
                keys = [self._names[name] for name in names if name in self._names]
                for key in [one for one in keys if one in self._futures] or [None]:
                    self._on_death(Death(key, f"worker {worker} (gone)", 1, False))
        self._processing = processing

    def _check_versions(self) -> None:
        ours = made_with()
        found = self._client.run(made_with)
        if not found:
            raise WbcError(f"--cluster {self.address}: there are no workers; start some first")
        for worker, theirs in found.items():
            apart = [name for name in ours if theirs.get(name) != ours[name]]
            if apart:
                told = ", ".join(f"{name} {theirs.get(name)}, here {ours[name]}" for name in apart)
                raise WbcError(f"--cluster {self.address}: worker {worker} has {told}")
