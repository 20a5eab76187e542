"""Columns of a run as a pandas data frame, or in a Parquet file."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

from wbc.extras import require
from wbc.files import write_whole
from wbc.run.columns import Column

Frame: TypeAlias = Any  # a pandas.DataFrame
SUMMARY = "wbc.summary"  # the key of the file's metadata under which its JSON text is


def frame_of(columns: Sequence[Column], what: str) -> Frame:
    """Return columns as a data frame, a row per tick, heads with units.

    Raises
    ------
    MissingPackageError
        pandas is not installed, which ``what`` needs.
    """
    require("pandas", what)
    import pandas

    return pandas.DataFrame(dict(columns))


def write_parquet(path: str | Path, columns: Sequence[Column], summary: str) -> None:
    """Write columns into a Parquet file, whole or not at all, with a summary's JSON text.

    Raises
    ------
    MissingPackageError
        pyarrow is not installed.
    OSError
        The file cannot be written.
    """
    require("pyarrow", "a result as .parquet")
    import pyarrow
    from pyarrow import parquet

    table: Any = pyarrow.table(dict(columns)).replace_schema_metadata({SUMMARY: summary})
    packed = io.BytesIO()
    parquet.write_table(table, packed)
    write_whole(path, lambda file: file.write(packed.getbuffer()))
