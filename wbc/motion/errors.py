"""The errors of a recording that cannot be used as it is."""

from __future__ import annotations

from collections.abc import Iterable

from wbc.errors import InvalidInputError, UnknownNameError


class RecordingError(InvalidInputError):
    """A recording holds something unusable; the message says what, where, and what to do.

    Parameters
    ----------
    what:
        What is wrong, and what to do.
    file:
        The file, as it was named.
    column:
        The column's name in the file, if one is to blame.
    row:
        The row of numbers, counted from 1, likewise.
    line:
        That row's line in a text file.
    """

    def __init__(
        self,
        what: str,
        file: str,
        column: str | None = None,
        row: int | None = None,
        line: int | None = None,
    ) -> None:
        self.file, self.column, self.row, self.line = file, column, row, line
        places = [f"column {shortened(column)!r}"] if column is not None else []
        if row is not None:
            places.append(f"row {row}" + (f" (line {line})" if line is not None else ""))
        super().__init__(f"{': '.join([file, ', '.join(places)] if places else [file])}: {what}")


class UnknownColumnError(UnknownNameError):
    """A recording has a column that means nothing for its robot.

    Parameters
    ----------
    file:
        The file, as it was named.
    name:
        The column's name in the file.
    choices:
        Names that columns may have.
    """

    def __init__(self, file: str, name: str, choices: Iterable[str]) -> None:
        super().__init__("column", shortened(name), choices)
        self.file = file
        self.args = (f"{file}: {self}; correct it, or declare that it be passed over (ignore)",)


def shortened(text: str, most: int = 60) -> str:
    """Return a text from a file as it is shown in a message."""
    return text if len(text) <= most else f"{text[:most]}..."
