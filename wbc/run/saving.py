"""Writing results: strict JSON and .npz, whole or not at all."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError
from wbc.files import write_whole

FORMATS = (".json", ".npz")


def result_format(path: str | Path) -> str:
    """Return the ending of a result file.

    Raises
    ------
    InvalidInputError
        Neither ``.json`` nor ``.npz``.
    """
    ending = Path(path).suffix.lower()
    if ending not in FORMATS:
        raise InvalidInputError(
            f"{path}: a result is written as .json (summary) or .npz (summary and histories)"
        )
    return ending


def save_result(
    path: str | Path,
    summary: Mapping[str, Any],
    arrays: Callable[[], Mapping[str, NDArray[np.generic]]],
) -> None:
    """Write a summary to a ``.json`` file, or summary and arrays to an ``.npz`` file.

    The file appears whole or not at all. JSON is strict: what is not finite is null. In an ``.npz``
    the entry ``summary`` holds the JSON text.

    Raises
    ------
    InvalidInputError
        Another ending.
    OSError
        The file cannot be written.
    """
    text = json_text(summary)
    if result_format(path) == ".npz":
        entries: dict[str, Any] = {"summary": np.array(text), **arrays()}
        write_whole(Path(path), lambda file: np.savez_compressed(file, **entries))
    else:
        write_whole(Path(path), lambda file: file.write(text.encode()))


def json_text(summary: Mapping[str, Any]) -> str:
    """Return strict JSON, lists of numbers on one line; what is not finite is null."""
    text = json.dumps(_finite(summary), indent=2, allow_nan=False, ensure_ascii=False)
    # Raw line ends stand between values only, never inside a JSON string.
    lists = re.compile(r"\[\n\s*([^\[\]{}]*?)\n\s*\]")
    return lists.sub(lambda found: "[" + re.sub(r"\n\s*", " ", found[1]) + "]", text) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    return value
