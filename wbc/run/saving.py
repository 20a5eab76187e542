"""Writing results atomically: strict JSON, .npz, .csv and .parquet."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.extras import require
from wbc.files import as_text, ending_of, finite, write_arrays, write_text
from wbc.run.columns import write_parquet
from wbc.validate import Array

FORMATS = (".json", ".npz", ".csv", ".parquet")
DIGITS = "%.9g"  # of numbers in a table


def result_format(path: str | Path) -> str:
    """Return the ending of a result file.

    Raises MissingPackageError: ``.parquet`` needs pyarrow; InvalidInputError: none of ``.json``,
    ``.npz``, ``.csv`` and ``.parquet``.
    """
    what = "a result is written as .json (summary), .npz (summary and histories), .csv or .parquet"
    ending = ending_of(path, FORMATS, f"{what} (a table with a row per tick)")
    if ending == ".parquet":
        require("pyarrow", "a result as .parquet")
    return ending


def save_result(
    path: str | Path,
    summary: Mapping[str, Any],
    arrays: Callable[[], Mapping[str, NDArray[np.generic]]],
    columns: Callable[[], Sequence[tuple[str, Array]]],
) -> None:
    """Write a summary as ``.json``, summary and arrays as ``.npz``, or columns as a table.

    The file is written whole or not at all. JSON is strict: numbers that are not finite are null.
    In an ``.npz`` the entry ``summary`` is the JSON text. A ``.csv`` has its columns' names in the
    first line; a ``.parquet`` has the JSON text in its metadata, ``wbc.summary``.

    Raises InvalidInputError: another ending; OSError: the file cannot be written.
    """
    match result_format(path):
        case ".npz":
            write_arrays(path, {"summary": np.array(json_text(summary)), **arrays()})
        case ".csv":
            write_text(path, _csv_text(columns()))
        case ".parquet":
            write_parquet(path, columns(), json_text(summary))
        case _:
            write_text(path, json_text(summary))


def _csv_text(columns: Sequence[tuple[str, Array]]) -> str:
    """Return a table with a line of headers; missing values are ``nan``."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow([header for header, _ in columns])
    np.savetxt(text, np.column_stack([values for _, values in columns]), fmt=DIGITS, delimiter=",")
    return text.getvalue()


def json_text(summary: Mapping[str, Any]) -> str:
    """Return strict JSON, lists of numbers on one line; numbers that are not finite are null."""
    text = as_text(json.dumps(finite(summary), indent=2, allow_nan=False, ensure_ascii=False))
    # Raw line ends are between values only, never inside a JSON string.
    lists = re.compile(r"\[\n\s*([^\[\]{}]*?)\n\s*\]")
    return lists.sub(lambda found: "[" + re.sub(r"\n\s*", " ", found[1]) + "]", text) + "\n"


def plain(value: Any) -> Any:
    """Return ``value`` as plain data, as read from YAML: arrays and tuples as lists, paths as text.

    Dataclasses are mappings of their fields.
    """
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    if is_dataclass(value):
        return {part.name: plain(getattr(value, part.name)) for part in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return value
