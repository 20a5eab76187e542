"""Picture files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure

from wbc.errors import InvalidInputError
from wbc.view import style

# What must not be written by each format so that the same run gives the same file.
FORMATS: Mapping[str, Mapping[str, None]] = {
    ".png": {},
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
}


def picture_file(path: str | Path) -> Path:
    """Return a path that a picture can be written to.

    Raises
    ------
    InvalidInputError
        Unknown suffix, or no such folder.
    """
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise InvalidInputError(
            f"{path}: cannot write a picture with the suffix {path.suffix!r}; use one of"
            f" {', '.join(FORMATS)}"
        )
    if not path.parent.is_dir():
        raise InvalidInputError(f"{path}: there is no folder {path.parent}; make it first")
    return path


def save(figure: Figure, path: Path) -> None:
    """Write a figure to a file that :func:`picture_file` has passed.

    Raises
    ------
    InvalidInputError
        The system refuses to write it.
    """
    suffix = path.suffix.lower()
    try:
        figure.savefig(path, format=suffix[1:], dpi=style.DPI, metadata=dict(FORMATS[suffix]))
    except OSError as error:
        raise InvalidInputError(f"{path}: cannot be written: {error}") from error
