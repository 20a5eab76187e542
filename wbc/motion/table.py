"""Numbers with column names, from a CSV or NPZ file.

Sizes are checked before anything is unpacked or allocated: a file may declare any.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError
from wbc.files import ArrayFileError, read_arrays, system_message
from wbc.validate import LARGEST as MAX_NUMBER
from wbc.validate import Array

DELIMITERS = (",", ";", "\t")
NUMBERS = "iuf"  # kinds of arrays: integers and floats, neither complex nor bool
TEXTS = "US"
# Arrays of a motion for mjlab's and BeyondMimic's trackers, and the columns of a base.
TRACKER_ARRAYS = ("fps", "joint_pos", "joint_names", "body_pos_w", "body_quat_w", "body_names")
BASE = ("base_x", "base_y", "base_z", "base_qx", "base_qy", "base_qz", "base_qw")
MAX_BYTES = 1 << 30  # of a text file, and of all arrays of an NPZ file unpacked


class RecordingError(InvalidInputError):
    """A recording is unusable; the message says what is wrong, where, and what to do.

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
        That row's line in a text file, or the line to blame.
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
        elif line is not None:
            places.append(f"line {line}")
        super().__init__(f"{': '.join([file, ', '.join(places)] if places else [file])}: {what}")


def shortened(text: str, most: int = 60) -> str:
    """Return a text from a file, shortened for a message."""
    return text if len(text) <= most else f"{text[:most]}..."


@dataclass(frozen=True, eq=False)
class MotionTable:
    """Rows of numbers."""

    source: str  # the file, as it was named
    columns: tuple[str, ...]  # column names (k)
    values: Array  # numbers (n, k), NaN where there is none
    lines: tuple[int, ...] = ()  # line of each row in a text file, (n,); empty if it is not one

    def __post_init__(self) -> None:
        name, count = Counter(self.columns).most_common(1)[0] if self.columns else ("", 0)
        if count > 1:
            raise RecordingError("this column is there twice; remove one", self.source, name)
        if not len(self.values):
            raise RecordingError("it holds no rows of numbers", self.source)

    def error(self, what: str, column: int | None = None, row: int | None = None) -> RecordingError:
        """Return an error that names the place; ``row`` counts from 0."""
        name = None if column is None else self.columns[column]
        line = self.lines[row] if self.lines and row is not None else None
        return RecordingError(what, self.source, name, None if row is None else row + 1, line)


def numbers_of(rows: Sequence[Sequence[float]], source: str) -> Array:
    """Return rows of numbers as an array (n, k); they may be NaN or infinite."""
    if not rows:
        raise RecordingError("it holds no rows of numbers", source)
    values = np.array(rows)
    for row, column in np.argwhere(np.isfinite(values) & (np.abs(values) > MAX_NUMBER)):
        what = f"{values[row, column]:.3g} is no measured number"
        raise RecordingError(what, source, None, int(row) + 1)
    return values


def read_text(path: Path, strict: bool = True) -> str:
    """Return the text of a file; unless ``strict``, bytes that are not UTF-8 are replaced.

    Raises RecordingError: unreadable, too large, or not UTF-8.
    """
    check_file(path)
    try:
        return path.read_text(encoding="utf-8-sig", errors="strict" if strict else "replace")
    except UnicodeDecodeError as error:
        what = "it is not text in UTF-8; export it as CSV UTF-8"
        raise RecordingError(what, str(path)) from error
    except OSError as error:
        raise _unreadable(path, error) from error


def read_bytes(path: Path) -> bytes:
    """Return the bytes of a file. Raises RecordingError: unreadable or too large."""
    check_file(path)
    try:
        return path.read_bytes()
    except OSError as error:
        raise _unreadable(path, error) from error


def read_recorded(
    path: Path, pick: Callable[[list[str]], Collection[str]], kinds: Callable[[str], str]
) -> dict[str, NDArray[Any]]:
    """Return some arrays of an NPZ file; see :func:`wbc.files.read_arrays`.

    Raises RecordingError: unreadable or too large, or arrays of another kind.
    """
    try:
        return read_arrays(path, pick, kinds, MAX_BYTES)
    except ArrayFileError as error:
        raise RecordingError(error.what, str(path), error.name) from error


def check_file(path: Path) -> None:
    """Raise RecordingError unless it is a regular file that is not too large."""
    source = str(path)
    try:
        regular, size = path.is_file(), path.stat().st_size
    except (OSError, ValueError) as error:  # ValueError: NUL in the path
        raise _unreadable(path, error) from error
    if not regular:
        raise RecordingError("cannot be read: it is not a regular file", source)
    if size > MAX_BYTES:
        raise RecordingError(f"it has {size} bytes; at most {MAX_BYTES} can be read", source)


def _unreadable(path: Path, error: Exception) -> RecordingError:
    return RecordingError(f"cannot be read: {shortened(system_message(error), 200)}", str(path))


# ---------------------------------------------------------------------- CSV


def read_csv(path: Path, usual: tuple[str, ...] = ()) -> MotionTable:
    """Read a CSV file, whose first line names the columns; empty cells are NaN.

    That line may begin with ``#``, as NumPy writes it, after comments that begin so too.

    ``usual``: column names of a file that has as many columns without names.

    Raises RecordingError: unreadable or too large, no rows, no names, a row of another length, a
    cell that is not a number, or a column name that is there twice.
    """
    source, text = str(path), read_text(path)
    numbered = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip()]
    header, named = _header(source, numbered)
    delimiter = _delimiter(header)
    columns = _names(source, header, delimiter, usual)
    found = list[list[float]]()
    lines = numbered if columns is usual else named
    for row, (number, line) in enumerate(lines, 1):
        cells = _cells(source, line, delimiter, row, number)
        if len(cells) != len(columns):
            what = f"it has {len(cells)} cells, but the header names {len(columns)} columns"
            raise RecordingError(what, source, None, row, number)
        found.append(cell_numbers(cells, source, row, number, columns))
    return MotionTable(source, columns, np.array(found), tuple(number for number, _ in lines))


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


def _names(source: str, header: str, delimiter: str, usual: tuple[str, ...]) -> tuple[str, ...]:
    columns = tuple(name.strip() for name in _cells(source, header, delimiter))
    if all(_is_number(name) for name in columns):
        if len(columns) == len(usual):
            return usual
        what = "its first line holds numbers; it must name the columns"
        if usual:
            what += f", unless they are the {len(usual)} of Unitree's files (base and all joints)"
            what += f"; it has {len(columns)}"
        raise RecordingError(what, source)
    if len(columns) == 1 and len(header.split()) > 1:
        what = f"its first line names only one column, {shortened(header)!r}"
        raise RecordingError(f"{what}; put commas, semicolons or tabs between names", source)
    return columns


def _cells(
    source: str, text: str, delimiter: str, row: int | None = None, line: int | None = None
) -> list[str]:
    """Return the cells of one line; quotes end with it."""
    try:
        return next(csv.reader([text], delimiter=delimiter))
    except csv.Error as error:
        raise RecordingError(f"cannot be read: {error}", source, None, row, line) from error


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text  # which Python allows between digits


def cell_numbers(
    cells: Sequence[str], source: str, row: int, line: int, columns: Sequence[str] = ()
) -> list[float]:
    """Return the numbers of a row's cells, NaN where one is empty."""
    try:
        if "_" not in "".join(cells):  # which Python allows between digits
            return [float(cell) if cell.strip() else np.nan for cell in cells]
    except ValueError:
        pass
    wrong = next(k for k, cell in enumerate(cells) if cell.strip() and not _is_number(cell))
    cell = cells[wrong].strip()
    comma = "," in cell and _is_number(cell.replace(",", "."))
    remedy = "; write decimals with a point" if comma else ""
    what = f"{shortened(cell)!r} is not a number{remedy}"
    raise RecordingError(what, source, columns[wrong] if columns else None, row, line)


# ---------------------------------------------------------------------- NPZ


def read_npz(path: Path, configuration: Sequence[str]) -> MotionTable:
    """Read an NPZ file.

    Either ``time`` and ``q`` (n, nq), as ``wbc run`` writes; or ``time``, ``names`` (k,) and
    ``positions`` (n, k); or the arrays of mjlab's trackers, with ``joint_names``; or one array
    (n,) for each column.

    ``configuration``: names of the columns of ``q``.

    Raises RecordingError: unreadable or too large, arrays of other shapes or not of numbers, or no
    rows.
    """
    check_file(path)
    source = str(path)
    arrays = read_recorded(
        path,  # of what ``wbc run`` writes only time and q are read
        lambda names: (
            ("time", "q") if "q" in names else TRACKER_ARRAYS if is_tracker_file(names) else names
        ),
        lambda name: NUMBERS + (TEXTS if name in ("names", "joint_names", "body_names") else ""),
    )
    if is_tracker_file(arrays):
        arrays = _from_tracker_arrays(arrays, source)
    columns: dict[str, Array] = {}
    stacked = "q" if "q" in arrays else "positions"
    if stacked in arrays:
        array, names = arrays.pop(stacked), configuration
        if stacked == "positions":
            names = [str(name) for name in arrays.pop("names", np.array([])).ravel()]
        if array.ndim != 2 or array.shape[1] != len(names):
            what = f"it has shape {array.shape}; expected (rows, {len(names)})"
            remedy = "; is it the motion of another robot?" if array.ndim == 2 else ""
            raise RecordingError(what + remedy, source, stacked)
        if len(set(names)) < len(names):
            raise RecordingError("a name is there twice; remove one", source, "names")
        columns |= zip(names, array.T, strict=True)
    for name, array in arrays.items():
        if array.ndim != 1:
            what = f"it has shape {array.shape}; expected one number for each row"
            raise RecordingError(what, source, name)
        if array.dtype.kind not in NUMBERS:
            raise RecordingError("it does not hold real numbers", source, name)
        columns[name] = array
    if not columns:
        raise RecordingError("it holds no arrays", source)
    first, length = next((name, len(values)) for name, values in columns.items())
    for name, values in columns.items():
        if len(values) != length:
            what = f"it has {len(values)} rows, but {first!r} has {length}"
            raise RecordingError(what, source, name)
    numbers = np.column_stack([*columns.values()]).astype(np.float64)
    return MotionTable(source, tuple(columns), numbers)


def is_tracker_file(names: Collection[str]) -> bool:
    """Return whether arrays of these names are those of mjlab's and BeyondMimic's trackers."""
    return {"joint_pos", "body_pos_w"} <= set(names)


def _from_tracker_arrays(arrays: dict[str, NDArray[Any]], source: str) -> dict[str, NDArray[Any]]:
    """Return time, names and positions of base, which is the first body, and joints.

    MuJoCo's first body is the world, and ``joint_pos`` may be its qpos, base first.
    """
    joints, rate = arrays["joint_pos"], arrays.get("fps", np.zeros(0)).ravel()
    if joints.ndim != 2:
        what = f"it has shape {joints.shape}; expected (n, joints)"
        raise RecordingError(what, source, "joint_pos")
    if "joint_names" not in arrays:
        what = "MuJoCo and PhysX number joints each in their own way; add an array joint_names"
        raise RecordingError(what, source, "joint_pos")
    if rate.size != 1 or not 0.0 < rate[0] <= 1e6:
        raise RecordingError("it is no rate in frames per second", source, "fps")
    names = arrays["joint_names"].ravel()
    joints = joints[:, len(BASE) :] if joints.shape[1] == len(BASE) + len(names) else joints
    first = int([*map(str, arrays.get("body_names", np.zeros(0)).ravel()[:1])] == ["world"])
    parts = list[NDArray[Any]]()
    for name, width in (("body_pos_w", 3), ("body_quat_w", 4)):
        body = arrays.get(name, np.zeros(0))
        if body.ndim != 3 or body.shape[1] <= first or body.shape[::2] != (len(joints), width):
            what = f"it has shape {body.shape}; expected ({len(joints)}, bodies, {width})"
            raise RecordingError(what, source, name)
        parts.append(body[:, first])
    quaternion = parts.pop()[:, [1, 2, 3, 0]]  # from w x y z
    return {
        "time": np.arange(len(joints)) / float(rate[0]),
        "names": np.concatenate((BASE, names)),
        "positions": np.hstack((*parts, quaternion, joints)),
    }
