"""A ring buffer of the last cycles, written to a file after an event.

It is in shared memory, for a process that writes: packing a log takes a hundred cycles. If the
loop's process is killed, that one still writes a log. Another process may show the log while the
loop fills it: no cycle waits for either.
"""

from __future__ import annotations

import json
import mmap
import multiprocessing
import signal
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.files import system_message, write_arrays
from wbc.hardware.real_time import drop_real_time, ignore_signals
from wbc.validate import Array, finite_number

FORMAT = "wbc hardware log 1"
LOOP_KILLED = "the loop's process is gone"
BYTES = 8  # of a number


class RingLog:
    """The last seconds of a loop, one row of numbers for each cycle, in shared memory.

    ``fields``: number of values of each field, by name; ``seconds``, ``dt``: length and period [s].
    """

    def __init__(self, fields: Mapping[str, int], seconds: float, dt: float) -> None:
        rows = max(round(finite_number("log, seconds", seconds, above=0.0) / dt), 1)
        ends = np.cumsum(list(fields.values())).tolist()
        self._columns = {
            name: slice(end - size, end)
            for (name, size), end in zip(fields.items(), ends, strict=True)
        }
        memory = mmap.mmap(-1, BYTES * (1 + rows * ends[-1]))
        self._count = np.frombuffer(memory, np.int64, 1)
        self._rows: Array = np.frombuffer(memory, float, offset=BYTES).reshape(rows, ends[-1])

    def __len__(self) -> int:
        return min(int(self._count[0]), len(self._rows))

    def add(self, values: Mapping[str, ArrayLike]) -> None:
        """Add a row; missing fields are NaN. Raises InvalidInputError: no such field."""
        row = self._rows[int(self._count[0]) % len(self._rows)]
        row[:] = np.nan
        for name, value in values.items():
            if name not in self._columns:
                raise InvalidInputError(f"log: no field {name!r}")
            row[self._columns[name]] = value
        self._count[0] += 1

    def newest(self) -> dict[str, Array]:
        """Return a copy of the last row by field; empty without any.

        Read from another process while rows are added, it may be a mix of two rows.
        """
        count = int(self._count[0])
        if not count:
            return {}
        row = self._rows[(count - 1) % len(self._rows)].copy()
        return {name: row[place] for name, place in self._columns.items()}

    def arrays(self, last: int | None = None) -> dict[str, Array]:
        """Return a copy of the last rows, oldest first, by field: (rows,) or (rows, size)."""
        count = int(self._count[0])
        rows = min(len(self) if last is None else last, len(self))
        selected = self._rows[np.arange(count - rows, count) % len(self._rows)]
        return {
            name: selected[:, place.start] if place.stop - place.start == 1 else selected[:, place]
            for name, place in self._columns.items()
        }


class LogWriter:
    """Writes logs of a ring: the first to ``path``, later ones with a number.

    ``ring``: filled by the process that makes this.
    ``path``: a file ending in ``.npz``.
    ``rows``: largest number of rows in a log: less than the ring's, which goes on meanwhile.
    ``made_of``: description of the run, as plain data.
    ``forked``: whether a process of its own writes, which is forked now; else each call blocks.

    ``written``: the files, in order; complete after :meth:`close`.
    ``errors``: what was not written, and why: a full disk ends no loop.
    """

    def __init__(
        self,
        ring: RingLog,
        path: str | Path,
        rows: int,
        made_of: Mapping[str, Any],
        *,
        forked: bool,
    ) -> None:
        self._ring, self._path, self._rows = ring, Path(path), rows
        self._made_of = json.dumps({"format": FORMAT, **made_of})
        self.written = list[Path]()
        self.errors = list[str]()
        self._pipe: Connection | None = None
        if forked:
            context = multiprocessing.get_context("fork")
            self._pipe, other = context.Pipe()
            self._process = context.Process(
                target=_serve_writes, args=(self, other, self._pipe), name="log", daemon=False
            )
            self._process.start()
            other.close()

    def write(self, events: Sequence[str], about: str) -> None:
        """Write the ring, or request that from the writing process."""
        if self._pipe is None:
            self.write_now(events, about)
            return
        try:
            self._pipe.send((tuple(events), about))
        except OSError:
            self.errors.append(f"{self._path}: the process that writes logs is gone")

    def write_now(self, events: Sequence[str], about: str) -> None:
        """Write the ring; record an error if that fails."""
        number = len(self.written) + len(self.errors)
        stem = self._path.stem if number == 0 else f"{self._path.stem}-{number}"
        path = self._path.with_name(f"{stem}.npz")
        content: dict[str, Any] = {**self._ring.arrays(self._rows), "made_of": self._made_of}
        content |= {"events": np.array(events or [""]), "about": about}
        try:
            write_arrays(path, content)
        except OSError as error:
            self.errors.append(f"{path}: {system_message(error)}; this log is lost: {about}")
        else:
            self.written.append(path)

    def close(self) -> None:
        """Wait until all logs are written."""
        if self._pipe is None:
            return
        try:
            self._pipe.send(None)
            self.written, errors = self._pipe.recv()
            self.errors += errors
        except (OSError, EOFError):
            self.errors.append(f"{self._path}: the process that writes logs was gone")
        self._process.join()
        self._pipe.close()
        self._pipe = None


def _serve_writes(writer: LogWriter, pipe: Connection, others: Connection) -> None:
    """Write on request, and once more if the loop's process is gone without closing."""
    others.close()
    writer._pipe = None
    ignore_signals()
    drop_real_time()
    while True:
        try:
            request = pipe.recv()
        except (EOFError, OSError):
            if len(writer._ring):  # else there was no cycle, and the file may be another run's
                writer.write_now((), LOOP_KILLED)
            return
        if request is None:
            pipe.send((writer.written, writer.errors))
            return
        writer.write_now(*request)


class Watcher:
    """Calls a function with the ring in a process that is forked now.

    ``watch``: it may return at any time; it is terminated with the loop.
    """

    def __init__(self, ring: RingLog, watch: Callable[[RingLog], None]) -> None:
        context = multiprocessing.get_context("fork")
        self._process = context.Process(target=_run_watch, args=(ring, watch), name="watch")
        self._process.start()

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.join()


def _run_watch(ring: RingLog, watch: Callable[[RingLog], None]) -> None:
    ignore_signals()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # by which it is ended
    drop_real_time()
    watch(ring)
