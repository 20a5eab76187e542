"""Numbers with column names, from a CSV or NPZ file."""

from __future__ import annotations

import csv
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wbc.motion.errors import RecordingError
from wbc.validate import Array

DELIMITERS = (",", ";", "\t")
NUMBERS = "iuf"  # kinds of arrays: whole numbers and fractions, not complex ones nor truth values
SHOWN = 40  # characters of a header that is not understood


@dataclass(frozen=True, eq=False)
class Table:
    """Rows of numbers.

    Attributes
    ----------
    source:
        The file, as it was named.
    columns:
        Column names (k).
    values:
        Numbers (n, k), NaN where there is none.
    lines:
        Line of each row in a text file, (n,); empty if it is not one.
    """

    source: str
    columns: tuple[str, ...]
    values: Array
    lines: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        double = [name for k, name in enumerate(self.columns) if name in self.columns[:k]]
        if double:
            raise RecordingError("this column is there twice; remove one", self.source, double[0])
        if not len(self.values):
            raise RecordingError("it holds no rows of numbers", self.source)

    def error(self, what: str, column: int | None = None, row: int | None = None) -> RecordingError:
        """Return an error that names the place; ``row`` counts from 0."""
        name = None if column is None else self.columns[column]
        line = self.lines[row] if self.lines and row is not None else None
        return RecordingError(what, self.source, name, None if row is None else row + 1, line)


def read_csv(path: Path) -> Table:
    """Return what a CSV file holds; its first line names the columns. Empty cells are NaN.

    That line may begin with ``#``, as NumPy writes it. Remarks, which do too, may come before it.

    Raises
    ------
    RecordingError
        Unreadable, no rows, no names, a row of another length, a cell that is not a number, or a
        column name that is there twice.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise RecordingError(
            "it is not text in UTF-8; export it as CSV UTF-8", str(path)
        ) from error
    except OSError as error:
        raise _unreadable(path, error) from error
    numbered = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip()]
    header, numbered = _header(str(path), numbered)
    delimiter = _delimiter(header)
    columns = _names(str(path), header, delimiter)
    numbers, rows = tuple(k for k, _ in numbered), [line for _, line in numbered]
    if not rows:
        raise RecordingError("it holds no rows of numbers", str(path))
    try:
        values: Array = np.loadtxt(rows, delimiter=delimiter, comments=None, ndmin=2)
    except ValueError:  # empty cells, which mean NaN, or a mistake: look at each cell
        values = _cell_by_cell(str(path), columns, rows, numbers, delimiter)
    if values.shape[1] != len(columns):
        raise _ragged(str(path), len(columns), values.shape[1], 0, numbers[0])
    return Table(str(path), columns, values, numbers)


def _header(source: str, numbered: list[tuple[int, str]]) -> tuple[str, list[tuple[int, str]]]:
    """Return the line of column names, and the lines after it."""
    if not numbered:
        raise RecordingError("it is empty; expected a line of column names", source)
    marked = next((k for k, (_, line) in enumerate(numbered) if line[0] != "#"), len(numbered))
    following = numbered[marked][1] if marked < len(numbered) else ""
    if marked and (not following or _is_number(following.split(_delimiter(following))[0])):
        return numbered[marked - 1][1].lstrip("# "), numbered[marked:]
    return following, numbered[marked + 1 :]


def _delimiter(line: str) -> str:
    return next((mark for mark in DELIMITERS if mark in line), ",")


def _names(source: str, header: str, delimiter: str) -> tuple[str, ...]:
    columns = tuple(name.strip() for name in next(csv.reader([header], delimiter=delimiter)))
    if all(_is_number(name) for name in columns):
        raise RecordingError("its first line holds numbers; it must name the columns", source)
    if len(columns) == 1 and len(header.split()) > 1:
        start = header if len(header) <= SHOWN else f"{header[:SHOWN]}..."
        what = f"its first line names but one column, {start!r}"
        raise RecordingError(f"{what}; set commas, semicolons or tabs between names", source)
    return columns


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _cell_by_cell(
    source: str,
    columns: tuple[str, ...],
    rows: Sequence[str],
    numbers: Sequence[int],
    delimiter: str,
) -> Array:
    values = np.full((len(rows), len(columns)), np.nan)
    for k, cells in enumerate(csv.reader(rows, delimiter=delimiter)):
        if len(cells) != len(columns):
            raise _ragged(source, len(columns), len(cells), k, numbers[k])
        for j, cell in enumerate(cells):
            if cell.strip():
                try:
                    values[k, j] = float(cell)
                except ValueError as error:
                    comma = "," in cell and _is_number(cell.replace(",", "."))
                    remedy = "; write decimals with a point" if comma else ""
                    what = f"{cell.strip()!r} is not a number{remedy}"
                    raise RecordingError(what, source, columns[j], k + 1, numbers[k]) from error
    return values


def _ragged(source: str, wanted: int, found: int, row: int, line: int) -> RecordingError:
    what = f"it has {found} cells, but the header names {wanted} columns"
    return RecordingError(what, source, None, row + 1, line)


def read_npz(path: Path, configuration: Sequence[str]) -> Table:
    """Return what an NPZ file holds.

    Either ``time`` and ``q`` (n, nq), as ``wbc run`` writes; or ``time``, ``names`` (k,) and
    ``positions`` (n, k); or one array (n,) for each column.

    Parameters
    ----------
    configuration:
        Names of the columns of ``q``.

    Raises
    ------
    RecordingError
        Unreadable, arrays of other shapes or not of numbers, or no rows.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            # What else `wbc run` writes beside q is not a recording.
            wanted = [name for name in file.files if "q" not in file.files or name in ("time", "q")]
            arrays = {name: np.asarray(file[name]) for name in wanted}
    except (OSError, ValueError, zipfile.BadZipFile, EOFError) as error:
        raise _unreadable(path, error) from error
    columns: dict[str, Array] = {}
    if "q" in arrays:
        columns |= _unstacked(path, "q", arrays.pop("q"), configuration)
    elif "positions" in arrays:
        names = [str(name) for name in np.atleast_1d(arrays.pop("names", np.array([])))]
        columns |= _unstacked(path, "positions", arrays.pop("positions"), names)
    for name, array in arrays.items():
        if array.ndim != 1:
            what = f"it has shape {array.shape}; expected one number for each row"
            raise RecordingError(what, str(path), name)
        columns[name] = _numbers(path, name, array)
    return _stacked(path, columns)


def _unstacked(path: Path, name: str, array: Array, columns: Sequence[str]) -> dict[str, Array]:
    if array.ndim != 2 or array.shape[1] != len(columns):
        what = f"it has shape {array.shape}; expected (rows, {len(columns)})"
        remedy = "; is it the motion of another robot?" if array.ndim == 2 else ""
        raise RecordingError(what + remedy, str(path), name)
    values = _numbers(path, name, array)
    if len(set(columns)) < len(columns):
        raise RecordingError("a name is there twice; remove one", str(path), "names")
    return {column: values[:, k] for k, column in enumerate(columns)}


def _numbers(path: Path, name: str, array: Array) -> Array:
    if array.dtype.kind not in NUMBERS:
        raise RecordingError("it does not hold real numbers", str(path), name)
    return np.asarray(array, dtype=np.float64)


def _stacked(path: Path, columns: dict[str, Array]) -> Table:
    if not columns:
        raise RecordingError("it holds no arrays", str(path))
    first, length = next((name, len(values)) for name, values in columns.items())
    for name, values in columns.items():
        if len(values) != length:
            what = f"it has {len(values)} rows, but {first!r} has {length}"
            raise RecordingError(what, str(path), name)
    return Table(str(path), tuple(columns), np.column_stack(list(columns.values())))


def _unreadable(path: Path, error: Exception) -> RecordingError:
    reason = getattr(error, "strerror", None) or str(error)
    return RecordingError(f"cannot be read: {reason}", str(path))
