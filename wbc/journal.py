"""Work done so far in a file, one line as each piece comes, so that a kill costs only the last."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from wbc.errors import InvalidInputError, WbcError
from wbc.files import why


class JournalError(WbcError):
    """The file cannot be written (full, read-only, a folder); what was kept before is there."""


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
    JournalError
        It cannot be read or written.
    """

    def __init__(self, path: Path, made_of: Mapping[str, Any]) -> None:
        self.path = path
        head = json.loads(json.dumps(made_of))  # as it will be read back
        try:
            # Without a buffer, which would be tried again where the file is closed.
            self._file = path.open("a+b", buffering=0)
        except OSError as error:
            raise JournalError(f"{path}: cannot be written: {why(error)}") from error
        try:
            self._lock()
            whole, self.entries = self._read(head)
            self._file.truncate(whole)  # what a kill left of a line
            if whole == 0:
                self._begin(head)
        except OSError as error:
            self._file.close()
            raise JournalError(f"{path}: cannot be used: {why(error)}") from error
        except BaseException:
            self._file.close()
            raise

    def add(self, entry: Mapping[str, Any]) -> None:
        """Keep an entry.

        Raises
        ------
        JournalError
            It cannot be written; those before are there.
        """
        whole = self._file.seek(0, os.SEEK_END)
        try:
            rest = json.dumps(entry, allow_nan=False).encode() + b"\n"
            while rest:
                rest = rest[self._file.write(rest) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            with contextlib.suppress(OSError):
                self._file.truncate(whole)  # half a line, which the next process would remove
            raise JournalError(
                f"{self.path}: cannot be written: {why(error)}; what was done before is kept there,"
                " and the same command goes on with it"
            ) from error

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

    def _begin(self, head: Mapping[str, Any]) -> None:
        """Write what entries depend on; where that fails, leave no empty file."""
        try:
            self.add(head)
        except JournalError as error:
            self.path.unlink(missing_ok=True)
            raise JournalError(str(error).partition(";")[0]) from error

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
