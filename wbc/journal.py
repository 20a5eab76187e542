"""Work done so far in a file, one line as each piece comes, so that a kill costs only the last."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from wbc.errors import InvalidInputError


class Journal:
    """A file of JSON lines: what the work depends on, then one entry in each; a context.

    It is locked: a second process is refused, so that nothing is done twice.

    Parameters
    ----------
    path:
        If it is there, it is gone on with.
    made_of:
        What the entries depend on, as plain data; a file of anything else is refused.

    Attributes
    ----------
    entries:
        Those that were there.

    Raises
    ------
    InvalidInputError
        Not such a file, or one of other work, or another process writes it.
    OSError
        It cannot be read or written.
    """

    def __init__(self, path: Path, made_of: Mapping[str, Any]) -> None:
        self.path = path
        head = json.loads(json.dumps(made_of))  # as it will be read back
        self._file = path.open("a+b")
        try:
            self._lock()
            whole, self.entries = self._read(head)
        except BaseException:
            self._file.close()
            raise
        self._file.truncate(whole)  # what a kill left of a line
        if whole == 0:
            self.add(head)

    def add(self, entry: Mapping[str, Any]) -> None:
        """Keep an entry."""
        self._file.write(json.dumps(entry, allow_nan=False).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def remove(self) -> None:
        """Delete the file: the work is done, and its result written."""
        self.path.unlink(missing_ok=True)
        self._file.close()

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: object, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InvalidInputError(
                f"{self.path}: another process is at this campaign; wait for it, or end it"
            ) from None

    def _read(self, head: Mapping[str, Any]) -> tuple[int, list[dict[str, Any]]]:
        """Return how many bytes of what is there are whole lines, and the entries in them."""
        self._file.seek(0)
        data = self._file.read()
        whole = data.rfind(b"\n") + 1
        try:
            lines = [json.loads(line) for line in data[:whole].splitlines()]
        except ValueError as error:
            raise not_ours(self.path, error) from error
        if not all(isinstance(line, dict) for line in lines):
            raise not_ours(self.path, "a line is no mapping")
        if lines and lines[0] != head:
            raise InvalidInputError(
                f"{self.path}: was left by another campaign ({differing(lines[0], head)} differs);"
                " delete it to begin anew, or write to another file"
            )
        return whole, lines[1:]


def not_ours(path: Path, why: object) -> InvalidInputError:
    """Return the error for a file with something else in it."""
    return InvalidInputError(
        f"{path}: is not what a campaign left; delete it to begin anew ({why})"
    )


def differing(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    """Return the names under which two heads differ, in words."""
    names = sorted(name for name in {*one, *other} if one.get(name) != other.get(name))
    return ", ".join(names) or "its head"
