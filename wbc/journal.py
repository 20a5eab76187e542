"""A journal of finished work, one line per item, so that a killed process loses only the last."""

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
from wbc.files import system_message


class JournalError(WbcError):
    """The file cannot be written (disk full, read-only, a folder); earlier entries are kept."""


class Journal:
    """A file of JSON lines: the inputs of the work, then one entry per line; a context manager.

    It is locked: a second process is refused, so that no work is done twice.

    ``path``: if it exists, it is continued.
    ``made_of``: the inputs that the entries depend on, as plain data; a file with others is
    refused.

    ``entries``: the entries of an existing file.

    Raises InvalidInputError: not such a file, or one with other inputs, or another process is
    writing it; JournalError: it cannot be read or written.
    """

    def __init__(self, path: Path, made_of: Mapping[str, Any]) -> None:
        self.path = path
        head = json.loads(json.dumps(made_of))  # as it will be read back
        try:
            # Without a buffer, which would be tried again where the file is closed.
            self._file = path.open("a+b", buffering=0)
        except OSError as error:
            raise JournalError(f"{path}: cannot be written: {system_message(error)}") from error
        try:
            self._lock()
            whole, self.entries = self._read(head)
            self._file.truncate(whole)  # an incomplete last line
            if whole == 0:
                self._write_head(head)
        except OSError as error:
            self._file.close()
            raise JournalError(f"{path}: cannot be used: {system_message(error)}") from error
        except BaseException:
            self._file.close()
            raise

    def add(self, entry: Mapping[str, Any]) -> None:
        """Append an entry. Raises JournalError: it cannot be written; earlier entries are kept."""
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
                f"{self.path}: cannot be written: {system_message(error)}; what was done before is"
                " kept there, and the same command goes on with it"
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

    def _write_head(self, head: Mapping[str, Any]) -> None:
        """Write the inputs; if that fails, leave no empty file."""
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
        """Return the number of bytes in complete lines, and the entries in them."""
        self._file.seek(0)
        data = self._file.read()
        whole = data.rfind(b"\n") + 1
        try:
            lines = [json.loads(line) for line in data[:whole].splitlines()]
        except ValueError as error:
            raise wrong_file_error(self.path, error) from error
        if not all(isinstance(line, dict) for line in lines):
            raise wrong_file_error(self.path, "a line is no mapping")
        if lines and lines[0] != head:
            other = differing_keys(lines[0], head)
            raise InvalidInputError(
                f"{self.path}: was left by another campaign ({other} differs);"
                " delete it to begin anew, or write to another file"
            )
        return whole, lines[1:]


def wrong_file_error(path: Path, why: object) -> InvalidInputError:
    """Return the error for a file with other content."""
    return InvalidInputError(
        f"{path}: is not what a campaign left; delete it to begin anew ({why})"
    )


def differing_keys(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    """Return the names under which two heads differ, in words."""
    names = sorted(name for name in {*one, *other} if one.get(name) != other.get(name))
    return ", ".join(names) or "its head"
