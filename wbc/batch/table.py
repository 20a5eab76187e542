"""Rows in a Parquet file, with the campaign and versions that made them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from wbc.errors import InvalidInputError
from wbc.files import write_whole

ENDING = ".parquet"
_MADE_OF = b"wbc"  # under this key of the schema's metadata


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]], made_of: Mapping[str, Any]) -> None:
    """Write rows as a table, whole or not at all.

    Columns are those of all rows in order of appearance; what a row lacks is null. A column of
    booleans, integers or numbers is that, of text is text, and of anything else is JSON text.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    import pyarrow
    from pyarrow import parquet

    names = dict.fromkeys(name for row in rows for name in row)
    columns = {name: _column([row.get(name) for row in rows]) for name in names}
    table = pyarrow.table(columns).replace_schema_metadata({_MADE_OF: json.dumps(made_of).encode()})
    write_whole(path, lambda file: parquet.write_table(table, file))


def read_rows(path: Path) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Return the rows of a file, and what they were made of.

    Raises
    ------
    InvalidInputError
        Not a file of ours.
    OSError
        It cannot be read.
    """
    import pyarrow
    from pyarrow import parquet

    try:
        table = parquet.read_table(path)
        made_of = json.loads((table.schema.metadata or {})[_MADE_OF])
    except (pyarrow.ArrowException, KeyError, ValueError) as error:
        raise InvalidInputError(f"{path}: is not a table that wbc batch wrote ({error})") from error
    return table.to_pylist(), made_of


def _column(values: Sequence[Any]) -> Any:
    import pyarrow

    kinds = {type(value) for value in values if value is not None}
    if kinds == {int, float}:
        kinds, values = {float}, [None if one is None else float(one) for one in values]
    types = {
        bool: pyarrow.bool_(), int: pyarrow.int64(), float: pyarrow.float64(), str: pyarrow.string()
    }  # fmt: skip
    if len(kinds) == 1 and (kind := next(iter(kinds))) in types:
        return pyarrow.array(values, types[kind])
    if not kinds:
        return pyarrow.nulls(len(values), pyarrow.string())
    return pyarrow.array([None if one is None else json.dumps(one) for one in values])
