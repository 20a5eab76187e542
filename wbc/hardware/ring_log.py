"""What happened lately, kept in memory; written to a file when something goes wrong.

The memory is shared with a process that writes: packing a log takes a hundred cycles. Where the
loop's own process is killed, that one is still there, and writes what happened before. Another
process may look at it while the loop fills it: whatever that does, no cycle waits.
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
from wbc.files import why, write_arrays
from wbc.hardware.real_time import leave_signals_to_the_loop, ordinary_priority
from wbc.validate import Array, finite_number

FORMAT = "wbc hardware log 1"
KILLED = "the loop's process is gone"
NUMBER = 8  # bytes


class RingLog:
    """The last seconds of a loop, one row of numbers for each cycle, in shared memory.

    Parameters
    ----------
    fields:
        How many numbers each has, by name.
    seconds, dt:
        How long it reaches back, and the period [s].
    """

    def __init__(self, fields: Mapping[str, int], seconds: float, dt: float) -> None:
        rows = max(round(finite_number("log, seconds", seconds, above=0.0) / dt), 1)
        ends = np.cumsum(list(fields.values())).tolist()
        self._places = {
            name: slice(end - size, end)
            for (name, size), end in zip(fields.items(), ends, strict=True)
        }
        memory = mmap.mmap(-1, NUMBER * (1 + rows * ends[-1]))
        self._count = np.frombuffer(memory, np.int64, 1)
        self._rows: Array = np.frombuffer(memory, float, offset=NUMBER).reshape(rows, ends[-1])

    def __len__(self) -> int:
        return min(int(self._count[0]), len(self._rows))

    def add(self, values: Mapping[str, ArrayLike]) -> None:
        """Add a row; fields that are not given are NaN.

        Raises
        ------
        InvalidInputError
            No such field.
        """
        row = self._rows[int(self._count[0]) % len(self._rows)]
        row[:] = np.nan
        for name, value in values.items():
            if name not in self._places:
                raise InvalidInputError(f"log: no field {name!r}")
            row[self._places[name]] = value
        self._count[0] += 1

    def newest(self) -> dict[str, Array]:
        """Return a copy of the last row by field; nothing if there is none.

        Read from another process while rows are added, it may be torn between two that follow.
        """
        count = int(self._count[0])
        if not count:
            return {}
        row = self._rows[(count - 1) % len(self._rows)].copy()
        return {name: row[place] for name, place in self._places.items()}

    def arrays(self, last: int | None = None) -> dict[str, Array]:
        """Return a copy of the last rows, oldest first, by field: (rows,) or (rows, size)."""
        count = int(self._count[0])
        rows = min(len(self) if last is None else last, len(self))
        chosen = self._rows[np.arange(count - rows, count) % len(self._rows)]
        return {
            name: chosen[:, place.start] if place.stop - place.start == 1 else chosen[:, place]
            for name, place in self._places.items()
        }


class LogWriter:
    """Writes logs of a ring: the first to ``path``, others get a number.

    Parameters
    ----------
    ring:
        Filled by the process that makes this.
    path:
        A file ending in ``.npz``.
    rows:
        How many are written at most: less than the ring has, for it turns on meanwhile.
    made_of:
        What the log says of what ran, as plain data.
    forked:
        Whether a process of its own writes, which is forked now; else each call waits.

    Attributes
    ----------
    written:
        The files, in order; complete after :meth:`close`.
    complaints:
        What was not written, and why: a full disk ends no loop.
    """

    def __init__(
        self, ring: RingLog, path: Path, rows: int, made_of: Mapping[str, Any], *, forked: bool
    ) -> None:
        self._ring, self._path, self._rows = ring, path, rows
        self._made_of = json.dumps({"format": FORMAT, **made_of})
        self.written = list[Path]()
        self.complaints = list[str]()
        self._pipe: Connection | None = None
        if forked:
            context = multiprocessing.get_context("fork")
            self._pipe, other = context.Pipe()
            self._process = context.Process(
                target=_serve, args=(self, other, self._pipe), name="log", daemon=False
            )
            self._process.start()
            other.close()

    def write(self, events: Sequence[str], about: str) -> None:
        """Write what the ring holds, or have it written."""
        if self._pipe is None:
            self.write_now(events, about)
            return
        try:
            self._pipe.send((tuple(events), about))
        except OSError:
            self.complaints.append(f"{self._path}: the process that writes logs is gone")

    def write_now(self, events: Sequence[str], about: str) -> None:
        """Write what the ring holds; keep going if that is not possible."""
        number = len(self.written) + len(self.complaints)
        stem = self._path.stem if number == 0 else f"{self._path.stem}-{number}"
        path = self._path.with_name(f"{stem}.npz")
        content: dict[str, Any] = {**self._ring.arrays(self._rows)}
        content |= {"events": np.array([*events, ""][: max(len(events), 1)]), "about": about}
        content["made_of"] = self._made_of
        try:
            write_arrays(path, content)
        except OSError as error:
            self.complaints.append(f"{path}: {why(error)}; this log is lost: {about}")
        else:
            self.written.append(path)

    def close(self) -> None:
        """Wait until all is written."""
        if self._pipe is None:
            return
        try:
            self._pipe.send(None)
            self.written, complaints = self._pipe.recv()
            self.complaints += complaints
        except (OSError, EOFError):
            self.complaints.append(f"{self._path}: the process that writes logs was gone")
        self._process.join()
        self._pipe.close()
        self._pipe = None


def _serve(writer: LogWriter, pipe: Connection, others: Connection) -> None:
    """Write when asked to; once more if who asks is gone without a word."""
    others.close()
    writer._pipe = None
    leave_signals_to_the_loop()
    ordinary_priority()
    while True:
        try:
            asked = pipe.recv()
        except (EOFError, OSError):
            if len(writer._ring):  # else it never began: a log of another run may be there
                writer.write_now((), KILLED)
            return
        if asked is None:
            pipe.send((writer.written, writer.complaints))
            return
        writer.write_now(*asked)


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
    leave_signals_to_the_loop()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # by which it is ended
    ordinary_priority()
    watch(ring)
